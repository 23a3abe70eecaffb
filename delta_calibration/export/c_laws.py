"""Print generated laws as C, line by line: each line is `name = one operation`.

The lines are read from the generated Python file, so that CasADi is not needed. Dead code is left
out: lines whose results do not reach a slot of the workspace that is used.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from delta_calibration.errors import ConfigError
from delta_calibration.model import library
from delta_calibration.model.law import STAGES, Law

SIGNS: dict[type[ast.AST], str] = {  # of C
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.BitAnd: "&",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.And: "&&",
    ast.Or: "||",
}
# min and max as in Python: the first operand if neither is less (NaN); defined in c_loops.py
_FUNCTIONS = {"abs": "fabs", "min": "smaller", "max": "larger"}
_NAMES = {"inf": "INFINITY", "nan": "NAN"}


@lru_cache(maxsize=64)
def law_in_c(
    law: Law, asked: tuple[str, ...], dimensions: tuple[int, ...] = ()
) -> tuple[Mapping[int, str], str]:
    """Print a law's stages as C functions; stage `near` only has derivatives by the pose.

    Args:
        law: law to print.
        asked: groups of inputs whose derivatives are used.
        dimensions: indices within the group of dimensions whose derivatives are used.

    Returns:
        Name of the C function by the address of each non-empty stage, and the text of all.

    Raises:
        ConfigError: the law has to be generated first, and CasADi is not installed; or its file
            holds an operation that this printer does not know.
    """
    module = library.module_of(law)
    functions = _functions(str(module.__file__))
    names: dict[int, str] = {}
    texts = []
    for stage in STAGES:
        address = int(module.ADDRESSES[stage])
        if stage not in functions or address in names:
            continue
        names[address] = re.sub(r"\W", "_", f"{law.name}_{stage}", flags=re.ASCII)
        wanted = [group for group in asked if stage != "near" or group == "x"]
        kept = dimensions if stage != "near" else ()
        lines = _wanted(functions[stage], _unused(law, wanted, kept))
        texts.append(_function(names[address], lines))
    return names, "\n".join(texts)


def _unused(law: Law, asked: Collection[str], dimensions: Collection[int]) -> set[int]:
    """Slots of the workspace for derivatives that are not used."""
    size = dict(law.groups)
    return {
        law.offsets[f"f_{group}"] + row * size[group] + i
        for group in law.by
        if group not in asked
        for row in range(law.outputs)
        for i in range(size[group])
        if group != "g" or i not in dimensions
    }


def _functions(file: str) -> dict[str, list[ast.Assign]]:
    tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    return {
        node.name: [line for line in node.body if isinstance(line, ast.Assign)]
        for node in tree.body
        if isinstance(node, ast.FunctionDef)
    }


def _wanted(lines: list[ast.Assign], unused: set[int]) -> list[ast.Assign]:
    """The lines that the used slots depend on, in their order."""
    needed: set[str] = set()
    kept = []
    for line in reversed(lines):
        target: Any = line.targets[0]
        stored = isinstance(target, ast.Subscript)
        if (target.slice.value in unused) if stored else (target.id not in needed):
            continue
        kept.append(line)
        needed |= {node.id for node in ast.walk(line.value) if isinstance(node, ast.Name)}
    return kept[::-1]


def _function(name: str, lines: list[ast.Assign]) -> str:
    if not lines:
        return f"static void {name}(double *w) {{ (void)w; }}\n"
    return "\n".join([f"static void {name}(double *w) {{", *_statements(lines), "}", ""])


def _statements(lines: list[ast.Assign]) -> Iterator[str]:
    for line in lines:
        target: Any = line.targets[0]
        if isinstance(target, ast.Subscript):
            yield f"    {_text(target)} = {_text(line.value)};"
        else:
            yield f"    const double {target.id} = {_text(line.value)};"


def _text(node: Any) -> str:
    """Print one expression as C; nested operands are in brackets."""
    match node:
        case ast.Name():
            return _NAMES.get(node.id, node.id)
        case ast.Constant():
            return repr(float(node.value))  # type: ignore[arg-type]
        case ast.Subscript():
            return f"w[{node.slice.value}]"  # type: ignore[attr-defined]
        case ast.UnaryOp(op=ast.USub()):
            return f"-{_inner(node.operand)}"
        case ast.BinOp(op=ast.Pow()):
            return f"pow({_text(node.left)}, {_text(node.right)})"
        case ast.BinOp():
            return f"{_inner(node.left)} {SIGNS[type(node.op)]} {_inner(node.right)}"
        case ast.Compare():
            sign = SIGNS[type(node.ops[0])]
            return f"{_inner(node.left)} {sign} {_inner(node.comparators[0])}"
        case ast.BoolOp():
            return f" {SIGNS[type(node.op)]} ".join(map(_inner, node.values))
        case ast.IfExp():
            return f"{_inner(node.test)} ? {_inner(node.body)} : {_inner(node.orelse)}"
        case ast.Call(func=ast.Name(id=name)):
            values = ", ".join(map(_text, node.args))
            return f"{_FUNCTIONS.get(name, name)}({values})"
    raise ConfigError(f"a generated law holds {ast.dump(node)}, which has no C here")


def _inner(node: Any) -> str:
    text = _text(node)
    plain = isinstance(node, ast.Name | ast.Subscript | ast.Call)
    positive = isinstance(node, ast.Constant) and not text.startswith("-")
    return text if plain or positive else f"({text})"
