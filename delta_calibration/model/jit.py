"""How functions are compiled: without fast mathematics, and kept for later processes."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cache
from hashlib import blake2s
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast

import numba
from llvmlite import ir
from numba import types
from numba.core.registry import CPUDispatcher
from numba.experimental import structref
from numba.extending import intrinsic

from delta_calibration.model import lowering

_Function = TypeVar("_Function", bound=Callable[..., Any])

_LAW = types.void(types.CPointer(types.float64))  # type: ignore[no-untyped-call,unused-ignore]
_STRICT = {"error_model": "numpy"}
_CONTRACTED = {**_STRICT, "fastmath": {"contract"}}
_IMPORT = re.compile(r"^from (delta_calibration[.\w]*) import", re.MULTILINE)
_LOADED: list[Any] = []  # their code lives as long as they do


def compiled(
    signature: str | None = None,
    contract: bool = False,
    borrows: bool = False,
    alone: bool = False,
) -> Callable[[_Function], _Function]:
    """Compile a function, at once if it has a signature, and keep the result for later processes.

    What was kept is thrown away when the function's own file changes. Functions and constants of
    other files become part of this one as well: the sources of those of the package that its own
    file imports from are part of the name that the result is kept under. Where no
    folder can be written (installed by root, run by a user without a home), each process compiles
    for itself.

    With `contract` a product and the sum it goes into may be rounded once instead of twice, where
    the processor has an instruction for both.

    A function that `borrows` makes no array and returns none: it works in those that it is handed,
    and does not count who holds them. Counting the arrays of a machine at every call of a small
    function costs more than its work.

    One that works in what it is handed for longer than a call is `alone`: no other thread of
    Python runs beside it.
    """
    njit: Any = numba.njit  # typed in some of numba's versions, in others not
    options: dict[str, Any] = {**(_CONTRACTED if contract else _STRICT)}
    if borrows:
        options["_nrt"] = False

    def decorate(function: _Function) -> _Function:
        taken = {__name__, *_taken_from(sys.modules[function.__module__])}
        digest = _digest("".join(map(_sources, sorted(taken))))
        function.__qualname__ = f"{function.__qualname__}_{digest}"
        return cast(_Function, _kept(njit, function, signature, nogil=not alone, **options))

    return decorate


def law(function: Any, digest: str) -> int:
    """Compile a generated law, a function of its workspace, and return its address.

    Args:
        function: of a generated file.
        digest: of that file; part of the name that the machine code is kept under, since a file
            may change and have the same length and date.
    """
    own = f"{function.__qualname__}_{digest}_{_digest(_sources(lowering.__name__))}"
    function.__qualname__ = own
    made = _kept(numba.cfunc, lowering.thin(function), _LAW, **_CONTRACTED)
    _LOADED.append(made)
    return int(made.address)


@cache
def idle() -> int:
    """Address of a stage in which there is nothing to do."""

    def nothing(w: Any) -> None:
        pass

    made = _kept(numba.cfunc, nothing, _LAW)
    _LOADED.append(made)
    return int(made.address)


def _digest(text: str) -> str:
    return blake2s(text.encode(), digest_size=8).hexdigest()


@cache
def _sources(name: str) -> str:
    """Of a module, and of those of the package that it imports from."""
    module = sys.modules[name]
    text = Path(str(module.__file__)).read_text(encoding="utf-8")
    return "".join([text, *map(_sources, _taken_from(module))])


@cache
def _taken_from(module: ModuleType) -> tuple[str, ...]:
    """Modules of the package, and of compiled functions, that one imports from; not this one."""
    text = Path(str(module.__file__)).read_text(encoding="utf-8")
    values = vars(module).values()
    functions = {v.py_func.__module__ for v in values if isinstance(v, CPUDispatcher)}
    others = functions | {*_IMPORT.findall(text)} & {*sys.modules}
    return tuple(sorted(others - {__name__, module.__name__}))


def _kept(make: Any, function: Any, signature: Any, **options: Any) -> Any:
    try:
        return make(signature, cache=True, **options)(function)
    except RuntimeError:  # no folder to keep it in
        return make(signature, **options)(function)


def _call(typing: Any, address: Any, workspace: Any) -> Any:
    """Call the law at an address on a workspace (s,)."""
    del typing
    signature = types.void(address, workspace)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        number, array = args
        data = context.make_array(signature.args[1])(context, builder, array).data
        kind = ir.FunctionType(ir.VoidType(), [data.type])
        builder.call(builder.inttoptr(number, kind.as_pointer()), [data])
        return context.get_dummy_value()

    return signature, generate


call: Any = intrinsic(_call)  # in compiled functions: call(address, workspace)


@structref.register
class HeldType(types.StructRef):  # type: ignore[misc,unused-ignore]
    """Type of what is held for compiled functions, see `Held`."""

    def preprocess_fields(self, fields: Any) -> Any:
        """Any value whatever."""
        unliteral: Any = types.unliteral
        return tuple((name, unliteral(kind)) for name, kind in fields)


class Held(structref.StructRefProxy):  # type: ignore[misc,unused-ignore]
    """Arrays taken over by compiled functions once, and handed to them by one reference.

    Handing over a machine's arrays one by one takes longer than what is computed with them.
    Inside a compiled function they are `held.value`.
    """

    def __new__(cls, value: Any) -> Any:
        """Take over a (nested) named tuple of arrays."""
        return _hold(value)


_structref: Any = structref  # typed in some of numba's versions, in others not
_structref.define_constructor(Held, HeldType, ["value"])
_structref.define_attributes(HeldType)
_structref.define_boxing(HeldType, Held)


def _hold_value(value: Any) -> Any:
    return Held(value)


_hold: Any = _kept(numba.njit, _hold_value, None)
