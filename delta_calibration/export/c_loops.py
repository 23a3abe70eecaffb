"""Translate the compiled loops of the chain to C: functions of `model` and `compensation`.

The functions are the same Python sources that numba compiles for the package: those that borrow
the arrays they work in (`model/jit.py`). They may use numbers, arrays of one or two axes, slices,
records, and calls of each other and of laws; anything else is refused.

Arrays are passed by value as a pointer and two sizes: `Rows` may be written, `Numbers` may not.
Which of the two a parameter is depends on whether its function writes to it. Records are passed by
address.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from delta_calibration.errors import ConfigError
from delta_calibration.export.c_laws import SIGNS
from delta_calibration.export.c_numbers import LAWS, number

TYPES = """\
#include <string.h>

typedef void (*Law)(double *);

typedef struct { const double *at; int n, width; } Numbers; /* n rows of a width */
typedef struct { double *at; int n, width; } Rows;
typedef struct { const int *at; int n, width; } Wholes;
typedef struct { const Law *at; int n, width; } Laws;

static inline double larger(double a, double b) { return b > a ? b : a; }
static inline double smaller(double a, double b) { return b < a ? b : a; }
static inline Numbers read(Rows r) { const Numbers same = {r.at, r.n, r.width}; return same; }
static inline void copied(Rows to, Numbers from) { /* they lie apart */
    memcpy(to.at, from.at, sizeof(double) * (size_t)(to.n * to.width));
}
"""
_ARRAYS = {"Numbers": "double", "Rows": "double", "Wholes": "int", "Laws": "law"}
_OF_REALS = {"sqrt": "sqrt", "arcsin": "asin", "exp": "exp"}  # numpy's name: that of C


@dataclass(frozen=True)
class Kind:
    """Type of an expression: "int", "double", "law", an array, or the name of a record."""

    name: str
    rank: int = 0  # number of axes of an array
    fields: Any = field(default=None, compare=False)  # of a record: mapping of names to kinds
    parts: tuple[Kind, ...] = ()  # kinds of the values in a returned tuple


INT, REAL, NOTHING = Kind("int"), Kind("double"), Kind("void")
NUMBERS, ROWS = Kind("Numbers", 1), Kind("Rows", 1)


@dataclass(frozen=True)
class _Text:
    """C text of an expression; of a record its value, or its address if it is `apart`."""

    text: str
    kind: Kind
    apart: bool = False

    @property
    def place(self) -> str:
        """Address of a record."""
        return self.text if self.apart else f"&{self.text}"


def kind_of(value: Any, scratch: bool = False) -> Kind:
    """Kind of a record from an example, field by field; arrays of scratch can be written."""
    each = zip(value._fields, value, strict=True)
    fields = {name: _kind(name, own, scratch) for name, own in each}
    return Kind(type(value).__name__.strip("_"), fields=fields)


def _kind(name: str, value: Any, scratch: bool) -> Kind:
    if hasattr(value, "_fields"):
        return kind_of(value, scratch)
    if not isinstance(value, np.ndarray):
        return INT if isinstance(value, bool | int | np.integer) else REAL
    if value.dtype.kind != "f":
        return Kind("Laws" if name in LAWS else "Wholes", value.ndim)
    return Kind("Rows" if scratch else "Numbers", value.ndim)


def structures(kinds: list[Kind]) -> str:
    """Declare C structures of records; a structure that another one contains comes first."""
    found: dict[str, str] = {}
    for kind in kinds:
        _add_structure(kind, found)
    return "\n".join(found.values())


def _add_structure(kind: Kind, found: dict[str, str]) -> None:
    for own in kind.fields.values():
        if own.fields is not None:
            _add_structure(own, found)
    lines = [f"    {own.name} {name};" for name, own in kind.fields.items()]
    found[kind.name] = "\n".join(["typedef struct {", *lines, f"}} {kind.name};", ""])


def _bare(text: str) -> str:
    """Remove a pair of brackets around the whole expression."""
    depth = 0
    for i, sign in enumerate(text):
        depth += {"(": 1, ")": -1}.get(sign, 0)
        if depth == 0:
            return text[1:-1] if i == len(text) - 1 and text[0] == "(" else text
    return text


@dataclass
class Program:
    """Translated functions; each comes after those that it calls."""

    constants: Mapping[str, int]  # values of constants that differ in C
    functions: dict[str, _Function] = field(default_factory=dict)

    def add(self, function: Callable[..., Any], kinds: tuple[Kind, ...]) -> _Function:
        """Translate a compiled function for arguments of these kinds, if not done yet."""
        plain = function.py_func  # type: ignore[attr-defined]
        name = f"chain_{plain.__name__.strip('_')}"
        known = self.functions.get(name)
        if known is None:
            known = _Function(self, name, plain, kinds)
            known.translate()
            self.functions[name] = known
        if known.plain is not plain or known.ranks != tuple(kind.rank for kind in kinds):
            raise refused(plain, None, "is called with arrays of other axes, or has a namesake")
        return known

    @property
    def text(self) -> str:
        """C text of all functions; each comes after those that it calls."""
        made = {name: own.returned for name, own in self.functions.items() if own.returned.parts}
        pairs = {kind.name: _pair(kind) for kind in made.values()}
        return "\n".join([*pairs.values(), *(own.text for own in self.functions.values())])


def refused(plain: Any, node: ast.AST | None, why: str) -> ConfigError:
    """Error for a function that cannot be translated."""
    line = "" if node is None else f": {ast.unparse(node).splitlines()[0]}"
    return ConfigError(f"{plain.__module__}.{plain.__name__}{line}: {why}")


def _pair(kind: Kind) -> str:
    parts = " ".join(f"{part.name} part_{i};" for i, part in enumerate(kind.parts))
    return f"typedef struct {{ {parts} }} {kind.name};"


@cache
def _parsed(plain: Any) -> Any:
    """Syntax tree of a function."""
    return ast.parse(textwrap.dedent(inspect.getsource(plain))).body[0]


class _Function:
    """Translation of one function: determines the kinds of its names, then its lines."""

    def __init__(self, program: Program, name: str, plain: Any, kinds: tuple[Kind, ...]) -> None:
        self.program, self.name, self.plain = program, name, plain
        node = _parsed(plain)
        self.body: list[ast.stmt] = node.body
        self.names = vars(sys.modules[plain.__module__])
        self.parameters = [argument.arg for argument in node.args.args]
        self.ranks = tuple(kind.rank for kind in kinds)
        self.kinds: dict[str, Kind] = {}
        for parameter, kind in zip(self.parameters, kinds, strict=True):
            self.kinds[parameter] = Kind("Numbers", kind.rank) if kind.name == "Rows" else kind
        self.used: set[str] = set()
        self.count = 0  # number of auxiliary names in C
        self.stale = False
        self.origin: dict[str, ast.expr] = {}  # expression that a name was assigned from
        self.returned = self._returned(node.returns)
        self.text = ""

    # --- the whole

    def translate(self) -> None:
        """Translate the function, repeatedly until the kinds of its names no longer change."""
        doc = inspect.getdoc(self.plain) or ""
        body = self.body[1:] if doc else self.body
        before: dict[str, Kind] = {}
        lines: list[str] = []
        while before != self.kinds:
            before, self.count = dict(self.kinds), 0
            if self.stale:  # kinds that were derived from a parameter before it became writable
                self.kinds = {name: self.kinds[name] for name in self.parameters}
                self.stale = False
            lines = [line for node in body for line in self.statement(node, "    ")]
        local = [name for name in self.kinds if name not in self.parameters]
        own = [f"    {self._declared(name)};" for name in local]
        idle = [f"    (void){name};" for name in self.kinds if name not in self.used]
        takes = ", ".join(map(self._declared_argument, self.parameters))
        head = f"static {self.returned.name} {self.name}({takes}) {{"
        about = textwrap.wrap(f"/* {doc.splitlines()[0]} */", 98) if doc else []
        head_lines = textwrap.wrap(head, 98, subsequent_indent="    ")
        self.text = "\n".join([*about, *head_lines, *own, *idle, *lines, "}", ""])

    def _declared(self, name: str) -> str:
        kind = self.kinds[name]
        if kind.fields is not None:
            return f"const {kind.name} *{name}"
        if kind.rank:
            return f"{kind.name} {name} = {{0, 0, 0}}"
        return f"{kind.name} {name} = 0"

    def _declared_argument(self, name: str) -> str:
        kind = self.kinds[name]
        return f"const {kind.name} *{name}" if kind.fields is not None else f"{kind.name} {name}"

    def _returned(self, node: Any) -> Kind:
        if isinstance(node, ast.Constant) and node.value is None:
            return NOTHING
        if isinstance(node, ast.Name) and node.id in ("int", "bool", "float"):
            return REAL if node.id == "float" else INT
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "tuple":
            parts = tuple(map(self._returned, node.slice.elts))  # type: ignore[attr-defined]
            return Kind("_".join(["Pair", *(part.name for part in parts)]), parts=parts)
        raise refused(self.plain, node, "is not returned in C")

    def refused(self, node: ast.AST) -> ConfigError:
        """Error for a statement or expression that cannot be translated."""
        return refused(self.plain, node, "has no C")

    # --- statements

    def statement(self, node: ast.stmt, indent: str) -> Iterator[str]:
        """C lines of one statement."""
        own: Any = getattr(self, f"_{type(node).__name__.lower()}", None)
        if own is None:
            raise self.refused(node)
        yield from own(node, indent)

    def _block(self, nodes: list[ast.stmt], indent: str) -> Iterator[str]:
        for node in nodes:
            yield from self.statement(node, indent + "    ")

    def _assign(self, node: ast.Assign, indent: str) -> Iterator[str]:
        for target in node.targets:
            yield from self._stored(target, node.value, indent)

    def _stored(self, target: ast.expr, value: ast.expr, indent: str) -> Iterator[str]:
        if isinstance(target, ast.Tuple):
            yield from self._several(target, value, indent)
        elif isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            array, number_ = self.written(target.value), self._counter()
            whole = target.slice.lower is None and target.slice.upper is None
            if array.kind.rank != 1 or not whole:
                raise self.refused(target)
            head = f"for ({number_} = 0; {number_} < {array.text}.n; {number_}++)"
            yield f"{indent}{head} {array.text}.at[{number_}] = {self.value(value).text};"
        else:
            if isinstance(target, ast.Name):
                self.origin[target.id] = value
            yield from self._put(target, self.value(value), indent)

    def _put(self, target: ast.expr, value: _Text, indent: str) -> Iterator[str]:
        if isinstance(target, ast.Name):
            if target.id == "_":
                return
            value = self._named(target.id, value)
            text = value.place if value.kind.fields else _bare(value.text)
            yield f"{indent}{target.id} = {text};"
        else:
            yield f"{indent}{self.written(target).text} = {_bare(value.text)};"

    def _named(self, name: str, value: _Text) -> _Text:
        """Assign a value to a name; the name's kind may have to be widened."""
        before, kind = self.kinds.get(name), value.kind
        mixed = {"Rows", "Numbers"}
        if before is not None and before != kind:
            if {before.name, kind.name} == mixed:
                kind = Kind("Numbers", kind.rank)
            elif {before, kind} == {INT, REAL}:
                kind = REAL
            else:
                raise refused(self.plain, None, f"{name} is of several kinds")
        self.kinds[name] = kind
        return self._as(value, kind)

    def _several(self, target: ast.Tuple, value: ast.expr, indent: str) -> Iterator[str]:
        if isinstance(value, ast.IfExp):
            body, other = value.body, value.orelse
            pairs = zip(body.elts, other.elts, strict=True)  # type: ignore[attr-defined]
            value = ast.Tuple([ast.IfExp(value.test, one, two) for one, two in pairs])
        if isinstance(value, ast.Attribute) and value.attr == "shape":
            value = ast.Tuple([ast.Subscript(value, ast.Constant(axis)) for axis in range(2)])
        if isinstance(value, ast.Tuple):
            yield from self._at_once(target.elts, value.elts, indent)
            return
        found = self.value(value)
        if not found.kind.parts:
            raise self.refused(value)
        self.count += 1
        pair = f"pair_{self.count}"
        yield f"{indent}{{"
        yield f"{indent}    const {found.kind.name} {pair} = {found.text};"
        for i, (own, part) in enumerate(zip(target.elts, found.kind.parts, strict=True)):
            yield from self._put(own, _Text(f"{pair}.part_{i}", part), indent + "    ")
        yield f"{indent}}}"

    def _at_once(
        self, targets: list[ast.expr], values: list[ast.expr], indent: str
    ) -> Iterator[str]:
        bases = [ast.unparse(target).partition("[")[0] for target in targets]
        later = [name.id for v in values[1:] for name in ast.walk(v) if isinstance(name, ast.Name)]
        if not {*bases} & {*later}:
            for target, value in zip(targets, values, strict=True):
                yield from self._stored(target, value, indent)
            return
        texts = [self.value(value) for value in values]
        self.count += 1
        held = [f"held_{self.count}_{i}" for i in range(len(texts))]
        yield f"{indent}{{"
        for name, text in zip(held, texts, strict=True):
            yield f"{indent}    const {text.kind.name} {name} = {text.text};"
        for target, name, text in zip(targets, held, texts, strict=True):
            yield from self._put(target, _Text(name, text.kind), indent + "    ")
        yield f"{indent}}}"

    def _augassign(self, node: ast.AugAssign, indent: str) -> Iterator[str]:
        value, sign = self.value(node.value), SIGNS[type(node.op)]
        yield f"{indent}{self.written(node.target).text} {sign}= {value.text};"

    def _expr(self, node: ast.Expr, indent: str) -> Iterator[str]:
        yield f"{indent}{self.value(node.value).text};"

    def _return(self, node: ast.Return, indent: str) -> Iterator[str]:
        if node.value is None:
            yield f"{indent}return;"
        elif isinstance(node.value, ast.Tuple):
            parts = ", ".join(self.value(each).text for each in node.value.elts)
            yield f"{indent}return ({self.returned.name}){{{parts}}};"
        else:
            yield f"{indent}return {_bare(self.value(node.value).text)};"

    def _break(self, node: ast.Break, indent: str) -> Iterator[str]:
        del node
        yield f"{indent}break;"

    def _continue(self, node: ast.Continue, indent: str) -> Iterator[str]:
        del node
        yield f"{indent}continue;"

    def _if(self, node: ast.If, indent: str) -> Iterator[str]:
        yield f"{indent}if ({_bare(self.value(node.test).text)}) {{"
        yield from self._block(node.body, indent)
        if node.orelse:
            yield f"{indent}}} else {{"
            yield from self._block(node.orelse, indent)
        yield f"{indent}}}"

    def _while(self, node: ast.While, indent: str) -> Iterator[str]:
        yield f"{indent}while ({_bare(self.value(node.test).text)}) {{"
        yield from self._block(node.body, indent)
        yield f"{indent}}}"

    def _for(self, node: ast.For, indent: str) -> Iterator[str]:
        name = node.target.id  # type: ignore[attr-defined]
        match node.iter:
            case ast.Call(func=ast.Name(id="range"), args=bounds):
                name = self._counter() if name == "_" else name
                self._named(name, _Text("0", INT))
                self.used.add(name)
                yield f"{indent}for ({self._range(name, bounds)}) {{"
            case _:
                whole, number_ = self.value(node.iter), self._counter()
                yield f"{indent}for ({number_} = 0; {number_} < {whole.text}.n; {number_}++) {{"
                yield from self._put(node.target, self._row(whole, number_), indent + "    ")
        yield from self._block(node.body, indent)
        yield f"{indent}}}"

    def _range(self, name: str, bounds: list[ast.expr]) -> str:
        texts = [self.value(bound).text for bound in bounds]
        first, last = texts[:2] if len(texts) > 1 else ("0", texts[0])
        if len(texts) == 3 and texts[2] != "(-1)":
            raise self.refused(bounds[2])
        if len(texts) == 3:
            return f"{name} = {first}; {name} > {last}; {name}--"
        return f"{name} = {first}; {name} < {last}; {name}++"

    def _counter(self) -> str:
        self.count += 1
        name = f"n_{self.count}"
        self.kinds[name] = INT
        self.used.add(name)
        return name

    # --- expressions

    def value(self, node: ast.expr) -> _Text:
        """Translate an expression, in brackets if it is composite."""
        own: Any = getattr(self, f"_of_{type(node).__name__.lower()}", None)
        if own is None:
            raise self.refused(node)
        found: _Text = own(node)
        return found

    def written(self, node: ast.expr) -> _Text:
        """Translate an expression that is written to; makes its array parameter one of `Rows`."""
        base: Any = node
        while isinstance(base, ast.Subscript) or (
            isinstance(base, ast.Name) and base.id in self.origin
        ):
            base = base.value if isinstance(base, ast.Subscript) else self.origin[base.id]
        name = base.id if isinstance(base, ast.Name) else ""
        if name in self.parameters and self.kinds[name].name == "Numbers":
            self.kinds[name] = Kind("Rows", self.kinds[name].rank)
            self.stale = True
        return self.value(node)

    def _as(self, value: _Text, kind: Kind) -> _Text:
        """Convert a value to a kind: `Rows` can be passed as `Numbers`."""
        if value.kind.name == "Rows" and kind.name == "Numbers":
            return _Text(f"read({value.text})", kind)
        return value

    def _of_name(self, node: ast.Name) -> _Text:
        self.used.add(node.id)
        if node.id in self.kinds:
            kind = self.kinds[node.id]
            return _Text(node.id, kind, apart=kind.fields is not None)
        if node.id in self.program.constants:
            return _Text(str(self.program.constants[node.id]), INT)
        return self._number(self.names.get(node.id), node)

    def _of_constant(self, node: ast.Constant) -> _Text:
        return self._number(node.value, node)

    def _number(self, value: Any, node: ast.expr) -> _Text:
        if isinstance(value, int):
            return _Text(f"({value})" if value < 0 else str(int(value)), INT)
        if isinstance(value, float):
            return _Text(f"({number(value)})" if value < 0 else number(value), REAL)
        raise self.refused(node)

    def _of_attribute(self, node: ast.Attribute) -> _Text:
        if isinstance(node.value, ast.Name) and node.value.id == "np":
            return self._number({"inf": np.inf, "nan": np.nan}.get(node.attr), node)
        whole = self.value(node.value)
        if whole.kind.fields is None:
            raise self.refused(node)
        kind = whole.kind.fields[node.attr]
        return _Text(f"{whole.text}{'->' if whole.apart else '.'}{node.attr}", kind)

    def _of_subscript(self, node: ast.Subscript) -> _Text:
        match node.value:
            case ast.Attribute(value=array, attr="shape"):
                member = {"0": "n", "1": "width"}[ast.unparse(node.slice)]
                return _Text(f"{self.value(array).text}.{member}", INT)
        array_, index = self.value(node.value), node.slice
        if isinstance(index, ast.Slice):
            return self._slice(array_, index)
        if isinstance(index, ast.Tuple):
            row, column = (self.value(each).text for each in index.elts)
            place = f"{row} * {array_.text}.width + {_bare(column)}"
            return _Text(f"{array_.text}.at[{place}]", Kind(_ARRAYS[array_.kind.name]))
        return self._row(array_, self.value(index).text)

    def _row(self, array: _Text, index: str) -> _Text:
        if array.kind.rank == 1:
            return _Text(f"{array.text}.at[{_bare(index)}]", Kind(_ARRAYS[array.kind.name]))
        kind, width = Kind(array.kind.name, 1), f"{array.text}.width"
        begin = f"{array.text}.at + {index} * {width}"
        return _Text(f"({kind.name}){{{begin}, {width}, 1}}", kind)

    def _slice(self, array: _Text, index: ast.Slice) -> _Text:
        """Some rows of an array, all of its columns."""
        low = "0" if index.lower is None else self.value(index.lower).text
        high = f"{array.text}.n" if index.upper is None else self.value(index.upper).text
        width = "1" if array.kind.rank == 1 else f"{array.text}.width"
        begin = low if array.kind.rank == 1 else f"{low} * {width}"
        text = f"({array.kind.name}){{{array.text}.at + {begin}, {high} - {low}, {width}}}"
        return _Text(text, array.kind)

    def _of_unaryop(self, node: ast.UnaryOp) -> _Text:
        own = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return _Text(f"!{own.text}", INT)
        if isinstance(node.op, ast.USub):
            return _Text(f"(-{own.text})", own.kind)
        raise self.refused(node)

    def _of_binop(self, node: ast.BinOp) -> _Text:
        left, right = self.value(node.left), self.value(node.right)
        if isinstance(node.op, ast.Pow):
            if right.text == "2":
                return _Text(f"({left.text} * {left.text})", left.kind)
            return _Text(f"pow({left.text}, {right.text})", REAL)
        if type(node.op) not in SIGNS:
            raise self.refused(node)
        kind = INT if left.kind == right.kind == INT else REAL
        divided = isinstance(node.op, ast.Div)
        first = f"(double){left.text}" if divided and kind == INT else left.text
        return _Text(f"({first} {SIGNS[type(node.op)]} {right.text})", REAL if divided else kind)

    def _of_compare(self, node: ast.Compare) -> _Text:
        values = [self.value(each).text for each in (node.left, *node.comparators)]
        signs = [SIGNS[type(op)] for op in node.ops]
        each = zip(values[:-1], signs, values[1:], strict=True)
        texts = [f"{one} {sign} {other}" for one, sign, other in each]
        return _Text(f"({' && '.join(texts)})", INT)

    def _of_boolop(self, node: ast.BoolOp) -> _Text:
        sign = f" {SIGNS[type(node.op)]} "
        return _Text(f"({sign.join(self.value(each).text for each in node.values)})", INT)

    def _of_ifexp(self, node: ast.IfExp) -> _Text:
        test, one, other = (self.value(each) for each in (node.test, node.body, node.orelse))
        kind = one.kind
        if {one.kind.name, other.kind.name} == {"Rows", "Numbers"}:
            kind = Kind("Numbers", one.kind.rank)
        elif {one.kind, other.kind} == {INT, REAL}:
            kind = REAL
        texts = self._as(one, kind).text, self._as(other, kind).text
        return _Text(f"({test.text} ? {texts[0]} : {texts[1]})", kind)

    def _of_call(self, node: ast.Call) -> _Text:
        match node.func:
            case ast.Name(id="call"):
                law, space = (self.value(each) for each in node.args)
                self.written(node.args[1])
                return _Text(f"{law.text}({space.text}.at)", NOTHING)
            case ast.Name(id="copy_into"):  # the compiler cannot know that they do not overlap
                target, source = self.written(node.args[0]), self.value(node.args[1])
                return _Text(f"copied({target.text}, {self._as(source, NUMBERS).text})", NOTHING)
            case ast.Name(id="len"):
                return _Text(f"{self.value(node.args[0]).text}.n", INT)
            case ast.Name(id="min" | "max" | "abs" | "float" | "int" | "bool" as name):
                return self._builtin(name, [self.value(each) for each in node.args])
            case ast.Attribute(value=ast.Name(id="np"), attr="isfinite"):
                return _Text(f"isfinite({self.value(node.args[0]).text})", INT)
            case ast.Attribute(value=ast.Name(id="np"), attr=name) if name in _OF_REALS:
                return _Text(f"{_OF_REALS[name]}({self.value(node.args[0]).text})", REAL)
            case ast.Name(id=name) if hasattr(self.names.get(name), "py_func"):
                return self._called(self.names[name], node)
        raise self.refused(node)

    def _builtin(self, name: str, values: list[_Text]) -> _Text:
        first = values[0]
        if name in ("float", "int", "bool"):
            kind = REAL if name == "float" else INT
            return first if first.kind == kind else _Text(f"({kind.name}){first.text}", kind)
        whole = all(each.kind == INT for each in values)
        if name == "abs":
            return _Text(f"fabs({first.text})", REAL)
        for other in values[1:]:
            a, b, sign = first.text, other.text, "<" if name == "min" else ">"
            named = "smaller" if name == "min" else "larger"
            text = f"({b} {sign} {a} ? {b} : {a})" if whole else f"{named}({a}, {b})"
            first = _Text(text, INT if whole else REAL)
        return first

    def _called(self, function: Any, node: ast.Call) -> _Text:
        values = [self.value(each) for each in node.args]
        known = self.program.add(function, tuple(value.kind for value in values))
        texts = []
        for each, name in zip(node.args, known.parameters, strict=True):
            kind = known.kinds[name]
            value = self.written(each) if kind.name == "Rows" else self.value(each)
            if kind.name == "Rows" and value.kind.name == "Numbers":
                continue  # `written` changed its kind, so the function is translated again
            texts.append(value.place if kind.fields else self._as(value, kind).text)
        return _Text(f"{known.name}({', '.join(texts)})", known.returned)
