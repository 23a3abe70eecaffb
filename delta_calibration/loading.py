"""Imports modules when a command or a node needs them."""

from __future__ import annotations

import gc
import importlib
import sys
from types import ModuleType


def load(name: str) -> ModuleType:
    """Import a module with the garbage collector off.

    Objects made by an import are never garbage; frozen, later collections skip them as well.
    """
    known = sys.modules.get(name)
    if known is not None:  # None marks a module that may not be imported
        return known
    collects = gc.isenabled()
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.freeze()
        if collects:
            gc.enable()
