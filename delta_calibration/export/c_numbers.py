"""Print records of the compiled chain as C: static arrays, and an initialiser that uses them."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

LAWS = ("law", "point", "mass")  # fields that hold addresses of laws
_WIDE = 98
IDLE = "idle"  # function of machine.c that does nothing


def number(value: float) -> str:
    """Print a double so that it is read back as the same value."""
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def constant(kind: str, name: str, value: Any, laws: Mapping[int, str]) -> str:
    """Print a (nested) record as a constant of the C structure `kind`.

    Args:
        kind: name of the C structure, whose members have the fields' names.
        name: name of the constant.
        value: record of numbers, arrays and records, or a named tuple.
        laws: name of the C function by the address of a law's stage; other addresses do nothing.
    """
    arrays: list[str] = []
    body = "\n".join(_members(name, value, laws, arrays, 1))
    return "\n".join([*arrays, f"static const {kind} {name} = {{", body, "};", ""])


def placed(name: str, value: Any) -> tuple[list[str], int]:
    """Print statements that place all arrays of a (nested) scratch record in one array, `next`.

    Also returns the total number of elements.
    """
    lines: list[str] = []
    return lines, _place(name, value, lines, 0)


def _place(path: str, value: Any, lines: list[str], begin: int) -> int:
    for field, part in zip(value._fields, value, strict=True):
        own = f"{path}.{field}"
        if hasattr(part, "_fields"):
            begin = _place(own, part, lines, begin)
        else:
            width = part.shape[1] if part.ndim == 2 else 1
            lines.append(f"    {own} = (Rows){{next + {begin}, {len(part)}, {width}}};")
            begin += part.size
    return begin


def _members(
    path: str, value: Any, laws: Mapping[int, str], arrays: list[str], depth: int
) -> Iterator[str]:
    """Yield the lines of an initialiser; the arrays that it points to are added to `arrays`."""
    indent = "    " * depth
    for field, part in zip(value._fields, value, strict=True):
        own = f"{path}_{field}"
        if hasattr(part, "_fields"):
            yield f"{indent}.{field} = {{"
            yield from _members(own, part, laws, arrays, depth + 1)
            yield f"{indent}}},"
        elif isinstance(part, np.ndarray):
            yield f"{indent}.{field} = {_array(own, field, part, laws, arrays)},"
        else:
            exact = isinstance(part, bool | int | np.integer)
            yield f"{indent}.{field} = {int(part) if exact else number(part)},"


def _array(name: str, field: str, values: Any, laws: Mapping[int, str], arrays: list[str]) -> str:
    """Initialiser of an array; its elements are a static array, or a null pointer if empty."""
    rows, width = len(values), values.shape[1] if values.ndim == 2 else 1
    if not values.size:
        return f"{{0, {rows if width == 1 else 0}, {width}}}"
    if field in LAWS:
        kind, texts = "Law", [laws.get(address, IDLE) for address in values.tolist()]
    elif values.dtype.kind == "f":
        kind, texts = "double", [number(each) for each in values.ravel().tolist()]
    else:
        kind, texts = "int", [str(each) for each in values.ravel().tolist()]
    lines = textwrap.wrap(", ".join(texts), _WIDE - 4, break_long_words=False)
    body = "\n".join(f"    {line}" for line in lines)
    arrays.append(f"static const {kind} {name}[] = {{\n{body}\n}};")
    return f"{{{name}, {rows}, {width}}}"
