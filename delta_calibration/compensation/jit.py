"""How functions are compiled here: without fast mathematics, kept for later processes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(signature: str | None = None) -> Callable[[_Function], _Function]:
    """Compile a function, at once if it has a signature, and keep the result for later processes.

    A function and those that it calls have to be in one file: what was kept is thrown away when
    its own file changes, and only then. Where no folder can be written (installed by root, run by
    a user without a home), each process compiles for itself.
    """
    njit: Any = numba.njit  # typed in some of numba's versions, in others not

    def decorate(function: _Function) -> _Function:
        try:
            made = njit(signature, cache=True, error_model="numpy")(function)
        except RuntimeError:
            made = njit(signature, error_model="numpy")(function)
        return cast(_Function, made)

    return decorate
