"""Direct translation of the lines of a generated law into LLVM instructions.

A generated law is thousands of lines `name = one operation`. numba's compiler is made for
programs: it takes half a minute for such a list. Here the list is read from the file and written
as LLVM instructions one by one; numba caches the result and links it like its own code.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_REAL = types.float64
_INDEX = ir.IntType(64)
_PLAIN = {
    ast.Add: "fadd",
    ast.Sub: "fsub",
    ast.Mult: "fmul",
    ast.Div: "fdiv",
}
_INTRINSIC = {"abs": "llvm.fabs", "floor": "llvm.floor", "ceil": "llvm.ceil"}
_COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


def thin(function: FunctionType, lanes: tuple[int, ...] = ()) -> FunctionType:
    """Replace a generated function by a single call, with the same name and the same file.

    numba caches its code beside the generated file, under the function's name. For a law of
    `lanes` (see `jit.law`) the call computes all of them.
    """
    own = function.__code__

    def body(typing: Any, w: Any) -> Any:
        """Fill the workspace."""
        del typing

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            del signature
            lines = _lines_of(own.co_filename, own.co_name)
            if lanes:
                _Lanes(context, builder, args[0], lanes).write(lines)
            else:
                _Lowering(context, builder, args[0]).write(lines)
            return context.get_dummy_value()

        return types.void(w), generate

    code = _call.__code__.replace(
        co_filename=own.co_filename, co_firstlineno=own.co_firstlineno, co_name=own.co_name
    )
    names = {"body": intrinsic(body), "__name__": function.__module__}
    made = FunctionType(code, names, own.co_name)
    made.__qualname__, made.__module__ = function.__qualname__, function.__module__
    return made


def _call(w: Any) -> None:
    body(w)  # type: ignore[name-defined]  # noqa: F821 - of the globals that `thin` gives it


def _lines_of(file: str, name: str) -> list[ast.stmt]:
    return next(
        node.body
        for node in _parsed(file).body
        if isinstance(node, ast.FunctionDef) and node.name == name
    )


@lru_cache(maxsize=1)  # the stages of a law follow each other
def _parsed(file: str) -> ast.Module:
    return ast.parse(Path(file).read_text(encoding="utf-8"))


class _Lowering:
    """Writes the instructions of one function: names are LLVM values, all real numbers."""

    def __init__(self, context: Any, builder: Any, workspace: Any) -> None:
        self.context = context
        self.builder = builder
        self.workspace = workspace
        self.names: dict[str, Any] = {"inf": self.real(math.inf), "nan": self.real(math.nan)}

    def write(self, lines: list[ast.stmt]) -> None:
        """Write all lines, in order."""
        for line in lines:
            if isinstance(line, ast.Assign):
                (target,), value = line.targets, self.value(line.value)
                if isinstance(target, ast.Name):
                    self.names[target.id] = value
                else:
                    self.builder.store(value, self.place(target))

    def place(self, node: Any) -> Any:
        """Address of w[number]."""
        index = ir.Constant(_INDEX, node.slice.value)
        return self.builder.gep(self.workspace, [index], inbounds=True)

    @staticmethod
    def real(number: float) -> Any:
        """LLVM constant of a number."""
        return ir.Constant(ir.DoubleType(), float(number))

    def value(self, node: Any) -> Any:
        """Value of a right side."""
        own: Callable[[Any], Any] = getattr(self, f"_{type(node).__name__.lower()}")
        return own(node)

    def _constant(self, node: ast.Constant) -> Any:
        return self.real(node.value)  # type: ignore[arg-type]

    def _name(self, node: ast.Name) -> Any:
        return self.names[node.id]

    def _subscript(self, node: ast.Subscript) -> Any:
        return self.builder.load(self.place(node))

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        return self.builder.fneg(self.value(node.operand))

    def _binop(self, node: ast.BinOp) -> Any:
        values = self.value(node.left), self.value(node.right)
        if isinstance(node.op, ast.Pow):
            return self.called(operator.pow, values)
        return getattr(self.builder, _PLAIN[type(node.op)])(*values)

    def _call(self, node: ast.Call) -> Any:
        name, values = node.func.id, [self.value(each) for each in node.args]  # type: ignore[attr-defined]
        if name in ("min", "max"):  # as in Python: the first, if neither is less
            one, other = values
            sign = "<" if name == "min" else ">"
            return self.builder.select(self.builder.fcmp_ordered(sign, other, one), other, one)
        if name in _INTRINSIC:
            known = self.builder.module.declare_intrinsic(_INTRINSIC[name], [ir.DoubleType()])
            return self.builder.call(known, values)
        return self.called(getattr(math, name), values)

    def _ifexp(self, node: ast.IfExp) -> Any:
        values = self.truth(node.test), self.value(node.body), self.value(node.orelse)
        return self.builder.select(*values)

    def truth(self, node: Any) -> Any:
        """Truth value of a comparison, or of several."""
        if isinstance(node, ast.BoolOp):
            one, other = map(self.truth, node.values)
            joined = self.builder.and_ if isinstance(node.op, ast.And) else self.builder.or_
            return joined(one, other)
        sign = _COMPARED[type(node.ops[0])]
        kind = self.builder.fcmp_unordered if sign == "!=" else self.builder.fcmp_ordered
        return kind(sign, self.value(node.left), self.value(node.comparators[0]))

    def called(self, function: Any, values: Any) -> Any:
        """Call numba's own code of a function of real numbers."""
        typing = self.context.typing_context
        known = typing.resolve_value_type(function)
        signature = known.get_call_type(typing, (_REAL,) * len(values), {})
        return self.context.get_function(known, signature)(self.builder, list(values))


class _Lanes(_Lowering):
    """Writes a function for all lanes: a loop that LLVM turns into vector instructions."""

    def __init__(self, context: Any, builder: Any, workspace: Any, lanes: tuple[int, ...]) -> None:
        super().__init__(context, builder, workspace)
        first, count, to, outputs, size = lanes
        self.own = {first + i: i for i in range(count)}  # slot, and which of a lane's numbers
        self.own |= {to + i: count + i for i in range(outputs)}
        number = builder.load(self.at(ir.Constant(_INDEX, size - 1)))
        self.count = builder.fptosi(number, _INDEX)
        self.behind = self.at(ir.Constant(_INDEX, size))
        self.lane: Any = None

    def write(self, lines: list[ast.stmt]) -> None:
        """Write all lines; what all lanes share is read before the loop."""
        shared = [line for line in lines if self.is_shared(line)]
        super().write(shared)
        with cgutils.for_range(self.builder, self.count, intp=_INDEX) as loop:  # type: ignore[no-untyped-call,unused-ignore]
            self.lane = loop.index
            super().write([line for line in lines if line not in shared])

    def is_shared(self, line: ast.stmt) -> bool:
        """Whether a line reads a slot that is the same for all lanes."""
        value: Any = getattr(line, "value", None)
        return isinstance(value, ast.Subscript) and value.slice.value not in self.own  # type: ignore[attr-defined]

    def at(self, index: Any, start: Any = None) -> Any:
        """Address of an index in the workspace, or counted from `start`."""
        return self.builder.gep(start or self.workspace, [index], inbounds=True)

    def place(self, node: Any) -> Any:
        """Address of w[number], or of this lane's own number there."""
        row = self.own.get(node.slice.value)
        if row is None:
            return super().place(node)
        begin = self.builder.mul(self.count, ir.Constant(_INDEX, row))
        return self.at(self.builder.add(begin, self.lane), self.behind)
