"""Modules that are loaded when a verb or a node asks for them."""

from __future__ import annotations

import gc
import importlib
import sys
from types import ModuleType


def load(name: str) -> ModuleType:
    """Import a module with the garbage collector off.

    What an import makes is never garbage; frozen, later collections do not look at it either.
    """
    known = sys.modules.get(name)
    if known is not None:  # None stands for what may not be imported
        return known
    collects = gc.isenabled()
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.freeze()
        if collects:
            gc.enable()
