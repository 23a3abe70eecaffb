"""How functions are compiled here: without fast mathematics, kept for later processes."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2s
from inspect import getsource
from types import ModuleType
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(
    signature: str | None = None, *others: ModuleType, contract: bool = False
) -> Callable[[_Function], _Function]:
    """Compile a function, at once if it has a signature, and keep the result for later processes.

    What was kept is thrown away when the function's own file changes, and only then: `others` are
    the other files of which functions end up in this one. Their sources become part of the name
    that the result is kept under. Where no folder can be written (installed by root, run by a user
    without a home), each process compiles for itself.

    With `contract` a product and the sum it goes into may be rounded once instead of twice, where
    the processor has an instruction for both.
    """
    njit: Any = numba.njit  # typed in some of numba's versions, in others not
    law = {"error_model": "numpy", "fastmath": {"contract"} if contract else False}
    sources = "".join(map(getsource, others)).encode()

    def decorate(function: _Function) -> _Function:
        if others:
            digest = blake2s(sources, digest_size=8).hexdigest()
            function.__qualname__ = f"{function.__qualname__}_{digest}"
        try:
            made = njit(signature, cache=True, **law)(function)
        except RuntimeError:
            made = njit(signature, **law)(function)
        return cast(_Function, made)

    return decorate
