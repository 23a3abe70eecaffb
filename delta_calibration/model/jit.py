"""Compilation of functions: without fast mathematics, cached for later processes."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from hashlib import blake2s
from pathlib import Path
from pickle import UnpicklingError
from types import ModuleType
from typing import Any, ClassVar, TypeVar, cast

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils, datamodel
from numba.core.extending import lower_getattr_generic
from numba.core.imputils import impl_ret_borrowed
from numba.core.registry import CPUDispatcher
from numba.experimental import structref
from numba.extending import intrinsic

from delta_calibration.lazy import cached_property
from delta_calibration.model import lowering
from delta_calibration.model.linking import SharedCache, share

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Kind = TypeVar("_Kind")

_LAW = types.void(types.CPointer(types.float64))  # type: ignore[no-untyped-call,unused-ignore]
_STRICT = {"error_model": "numpy"}
_CONTRACTED = {**_STRICT, "fastmath": {"contract"}}
_IMPORT = re.compile(r"^from (delta_calibration[.\w]*) import", re.MULTILINE)
_LOADED: list[Any] = []  # keeps the compiled laws, and so their code, alive


def compiled(
    signature: str | None = None,
    contract: bool = False,
    borrows: bool = False,
    alone: bool = False,
    shared: bool = False,
) -> Callable[[_Function], _Function]:
    """Compile a function, at once if it has a signature, and cache the result for later processes.

    The cached code is discarded when the function's own file changes. Functions and constants of
    other files are compiled into it as well: therefore the sources of the package's files that its
    own file imports from are part of its name in the cache. Where no folder can be written
    (installed by root, run by a user without a home), each process compiles for itself.

    With `contract` a product and the sum it goes into may be rounded once instead of twice, where
    the processor has an instruction for both.

    A function that `borrows` makes no array and returns none: it works in the arrays that it is
    given, without counting references. To count those of all arrays of a machine at every call of
    a small function would cost more than its work.

    A function that is given scratch arrays which outlive the call is `alone`: it holds Python's
    global lock, so that no other thread runs beside it.

    A large function that many others call is `shared`: it is compiled once, not again as a part
    of each of these; see `linking.py`.
    """
    njit: Any = numba.njit  # typed in some of numba's versions, in others not
    options: dict[str, Any] = {**(_CONTRACTED if contract else _STRICT)}
    if borrows:
        options["_nrt"] = False

    def decorate(function: _Function) -> _Function:
        taken = {__name__, *_taken_from(sys.modules[function.__module__])}
        digest = _digest("".join(map(_sources, sorted(taken))))
        function.__qualname__ = f"{function.__qualname__}_{digest}"
        made = _kept(njit, function, None, nogil=not alone, **options)
        if shared:
            share(made)
        if signature is not None:
            made.compile(signature)
            made.disable_compile()
        return cast(_Function, made)

    return decorate


def law(function: Any, digest: str, lanes: tuple[int, ...] = ()) -> int:
    """Compile a generated law, a function of its workspace, and return its address.

    Args:
        function: of a generated file.
        digest: of that file; part of the name of the machine code in the cache, since a file
            may change and have the same length and date.
        lanes: for a law of lanes, first slot and count of the inputs that each lane has of its
            own, the same of the outputs, and the workspace's size; its last number is their count.
    """
    own = f"{function.__qualname__}_{digest}_{_digest(_sources(lowering.__name__))}"
    function.__qualname__ = own
    made = _kept(numba.cfunc, lowering.thin(function, lanes), _LAW, **_CONTRACTED)
    _LOADED.append(made)
    return int(made.address)


@cache
def idle() -> int:
    """Address of a stage that does nothing."""

    def nothing(w: Any) -> None:
        pass

    made = _kept(numba.cfunc, nothing, _LAW)
    _LOADED.append(made)
    return int(made.address)


def _digest(text: str) -> str:
    return blake2s(text.encode(), digest_size=8).hexdigest()


@cache
def _sources(name: str) -> str:
    """Source text of a module and of all package modules that its imports reach, each once."""
    found: dict[str, str] = {}
    todo = [name]
    while todo:
        own = todo.pop()
        if own not in found:
            module = sys.modules[own]
            found[own] = Path(str(module.__file__)).read_text(encoding="utf-8")
            todo.extend(_taken_from(module))
    return "".join(found[own] for own in sorted(found))


@cache
def _taken_from(module: ModuleType) -> tuple[str, ...]:
    """Modules of the package or of compiled functions that one imports from; not this one."""
    text = Path(str(module.__file__)).read_text(encoding="utf-8")
    values = vars(module).values()
    functions = {v.py_func.__module__ for v in values if isinstance(v, CPUDispatcher)}
    others = functions | {*_IMPORT.findall(text)} & {*sys.modules}
    return tuple(sorted(others - {__name__, module.__name__}))


class _Kept(SharedCache):  # type: ignore[misc,unused-ignore]
    """Cache of machine code for later processes that ignores what another version made.

    numba checks the version only after loading an entry, and cannot load an entry that names a
    class or a module which no longer exists.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the cached code of a signature; None if there is none that can be used."""
        try:
            kept: Any = super()
            return kept.load_overload(sig, target_context)
        except (AttributeError, ImportError, EOFError, UnpicklingError):
            cast(Any, self)._cache_file.flush()
            return None


def _kept(make: Any, function: Any, signature: Any, **options: Any) -> Any:
    try:
        made = make(signature, cache=True, **options)(function)
    except RuntimeError:  # no folder for the cache
        return make(signature, **options)(function)
    if isinstance(made, CPUDispatcher):
        keep: Any = _Kept  # typed in some of numba's versions, in others not
        cast(Any, made)._cache = keep(function)
    return made


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


class RecordType(types.StructRef):  # type: ignore[misc,unused-ignore]
    """Type of the records of one class, by the types of their fields, see `record`."""

    def __init__(self, fields: Any) -> None:
        """Name the type by a digest: the name of nested records would fill a page."""
        super().__init__(fields)  # type: ignore[no-untyped-call,unused-ignore]
        self.name = f"{type(self).__name__}_{_digest(self.name)}"

    def preprocess_fields(self, fields: Any) -> Any:
        """Allow fields of any type."""
        unliteral: Any = types.unliteral
        return tuple((name, unliteral(kind)) for name, kind in fields)


class Record(structref.StructRefProxy):  # type: ignore[misc,unused-ignore]
    """A record in Python: its fields can be read but not changed."""

    _fields: ClassVar[tuple[str, ...]]
    _make: ClassVar[Any]
    _read: ClassVar[Any]

    def __new__(cls, *values: Any, **named: Any) -> Any:
        """Make a record from the values of all fields."""
        every = (*values, *(named[name] for name in cls._fields[len(values) :]))
        made = cls._make(*every)
        made.values = every
        return made

    @cached_property
    def values(self) -> tuple[Any, ...]:
        """Values of all fields; those of a record that compiled code has made are read from it."""
        return tuple(type(self)._read(self))

    def __iter__(self) -> Iterator[Any]:
        """Iterate over the values."""
        return iter(self.values)

    def __getattr__(self, name: str) -> Any:
        """Return the value of a field.

        Raises:
            AttributeError: no such field.
        """
        if name not in self._fields:
            raise AttributeError(f"{type(self).__name__} has no field {name!r}")
        return self.values[self._fields.index(name)]


def record(kind: type[_Kind]) -> type[_Kind]:
    """Turn a class of named fields into records that are passed by reference, compiled or not.

    A named tuple is passed to a compiled function array by array, which takes longer than the
    work of a small function. Of a record only the address is passed.
    """
    module, name = sys.modules[kind.__module__], kind.__name__
    fields: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
    names = {"__module__": module.__name__}
    form = type(f"{name}Type", (RecordType,), names)
    _register(form)
    setattr(module, f"{name}Type", form)  # where cached code looks for it
    made = type(name, (Record,), {**names, "__doc__": kind.__doc__, "_fields": fields})
    _structref.define_constructor(made, form, fields)
    _structref.define_boxing(form, made)
    made._make, made._read = _maker(made, fields), _reader(fields)  # type: ignore[attr-defined]
    return cast(type[_Kind], made)


def _register(form: Any) -> None:
    """Register a record type with numba: compiled functions can make and read its records.

    This follows numba's `structref`, which counts the references to a record at every read. A
    function that `borrows` does not count.
    """
    _models.default_manager.register(form, _models.models.StructRefModel)
    _structref.define_attributes(form)
    extending: Any = lower_getattr_generic
    extending(form)(_field)


def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    """Read a field of a record, whose data lie in memory behind numba's reference count."""
    record = _proxy(kind)(context, builder, value=value)
    counted = builder.bitcast(record.meminfo, _COUNTED.as_pointer())
    content = context.data_model_manager[kind.get_data_type()].get_value_type().as_pointer()
    place = builder.bitcast(builder.load(_gep(builder, counted, 0, 3)), content)
    fields = _proxy(kind.get_data_type())(context, builder, ref=place)
    return _borrowed(context, builder, kind.field_dict[name], getattr(fields, name))


def _reader(fields: tuple[str, ...]) -> Any:
    """Make the function that reads all fields of a record; compiled on its first, rare use."""
    read = _written("own", f"({', '.join(f'own.{name}' for name in fields)},)", {})
    njit: Any = numba.njit
    return staticmethod(njit(read))


def _maker(kind: Any, fields: tuple[str, ...]) -> Any:
    """Make the function that makes a record; numba types single values faster than a tuple."""
    every = ", ".join(fields)
    make = _written(every, f"kind({every})", {"kind": kind, "__name__": kind.__module__})
    make.__qualname__ = f"make_{kind.__name__}_{_digest(_sources(kind.__module__))}"
    # where numba keeps the machine code: beside the module of the class
    make.__code__ = make.__code__.replace(co_filename=str(sys.modules[kind.__module__].__file__))
    return _kept(numba.njit, make, None)


def _written(arguments: str, result: str, names: dict[str, Any]) -> Any:
    """Function of named arguments, written as text because numba takes no unknown number."""
    exec(f"def function({arguments}): return {result}", names)
    return names["function"]


_WORD, _BYTES = ir.IntType(64), ir.IntType(8).as_pointer()
_COUNTED = ir.LiteralStructType([_WORD, _BYTES, _BYTES, _BYTES, _WORD])  # numba's MemInfo
# typed in some of numba's versions, in others not
_structref: Any = structref
_models: Any = datamodel
_proxy: Any = cgutils.create_struct_proxy
_gep: Any = cgutils.gep
_borrowed: Any = impl_ret_borrowed
