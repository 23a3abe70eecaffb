"""Compiled functions whose machine code exists once, whoever calls them.

numba compiles a function that others call into each of these again, and so all that it calls
itself. The chain is called by thirty others, and is most of each. Here a caller's machine code
holds the function's name only; the linker finds the one machine code there is.

The names are the same in every process, so that callers can be kept for later ones: before the
machine code of a caller is loaded, that of the functions whose names it holds is. If one of them
is no longer there, the caller is compiled anew.
"""

from __future__ import annotations

import re
from copy import copy
from hashlib import blake2s
from typing import Any, cast

from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.registry import CPUDispatcher

_PREFIX = "shared_code"
_NAME = re.compile(rf"{_PREFIX}_\w+_of_[0-9a-f]{{16}}(?!\w)".encode())
_FUNCTIONS: dict[str, CPUDispatcher] = {}  # by the part of the name before their arguments'
_LINKED: set[str] = set()  # names that the linker knows


def share(dispatcher: Any) -> None:
    """Let compiled functions call one by name from now on, instead of containing its code."""
    function = dispatcher.py_func
    own = re.sub(r"\W", "_", f"{_PREFIX}_{function.__module__}_{function.__qualname__}")
    _FUNCTIONS[own] = dispatcher
    add, context = dispatcher.add_overload, dispatcher.targetctx

    def link(made: Any) -> None:
        """Tell the linker where the code of one signature is, and numba how to call it."""
        name, called = f"{own}_of_{_kinds(made.signature.args)}", copy(made.fndesc)
        address = made.library.get_pointer_to_function(called.llvm_func_name)
        if not address:  # callers contain its code then
            add(made)
            return
        binding.add_symbol(name, address)
        called.mangled_name = name
        context.remove_user_function(made.entry_point)
        context.insert_user_function(made.entry_point, called)
        _LINKED.add(name)
        add(made)

    dispatcher.add_overload = link


class _Impl(CompileResultCacheImpl):  # type: ignore[misc,unused-ignore]
    """Loads kept machine code, and before it the shared functions that it calls."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Load machine code after what it calls; None if that cannot be had."""
        (_, _, (code, _)), *_ = payload
        if not all(map(_linked, {name.decode() for name in _NAME.findall(code)})):
            return None
        whole: Any = super()
        return whole.rebuild(target_context, payload)


class SharedCache(FunctionCache):  # type: ignore[misc,unused-ignore]
    """Cache of machine code that may call shared functions."""

    _impl_class = _Impl


def _linked(name: str) -> bool:
    """Whether the linker knows a name, after what is kept of its function has been loaded."""
    own, _, kinds = name.rpartition("_of_")
    function = cast(Any, _FUNCTIONS.get(own))
    index = getattr(getattr(function, "_cache", None), "_cache_file", None)
    if name not in _LINKED and index is not None:
        for arguments, *_ in index._load_index():
            if _kinds(arguments) == kinds:
                function.compile(arguments)
    return name in _LINKED


def _kinds(arguments: Any) -> str:
    return blake2s(str(tuple(arguments)).encode(), digest_size=8).hexdigest()
