"""Reads and evaluates equations written by a diagnosis: `dq_1 = a_1 sin(4 q_1) + b_1`.

Only arithmetic and a few functions are executed, whatever the text contains.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LONGEST = 20_000  # characters
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[^\W\d]\w*)"
    r"|(?P<sign>\*\*|<=|>=|[-+*/^(),<>]))"
)
_WRITTEN = str.maketrans({"−": "-", "·": "*", "×": "*", "[": "(", "]": ")"})
_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "sign": np.sign,
    "abs": np.abs,
    "step": lambda x: np.where(x > 0, 1.0, 0.0),
    "max": lambda *of: reduce(np.maximum, of),
    "min": lambda *of: reduce(np.minimum, of),
}
_TWO: dict[type[ast.AST], Callable[[Array, Array], Array]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Gt: operator.gt,
    ast.Lt: operator.lt,
    ast.GtE: operator.ge,
    ast.LtE: operator.le,
}


class EquationError(ValueError):
    """An equation that cannot be read or evaluated; the message states the place."""


@dataclass(frozen=True)
class Equation:
    """One equation: its left side, and the names on its right side."""

    left: str
    names: frozenset[str]
    _right: ast.expr

    def of(self, known: Mapping[str, Array]) -> Array:
        """Value of the right side, with all names known; a comparison is 1 if it holds, else 0.

        Raises:
            EquationError: a name is not known, or a function takes other arguments.
        """
        with np.errstate(all="ignore"):
            return np.asarray(_value(self._right, known), dtype=float)


def equations(text: str) -> tuple[Equation, ...]:
    """The equations of a law, separated by `; `.

    A multiplication sign may be left out (`2 q_1`, `a (b + c)`); a power is `^` or `**`.

    Raises:
        EquationError: an equation has no left side, or cannot be read.
    """
    if len(text) > _LONGEST:
        raise EquationError(f"an equation of {len(text)} characters; at most {_LONGEST}")
    parts = [part for part in re.split(r"[;\n]", text.translate(_WRITTEN)) if part.strip()]
    if not parts:
        raise EquationError("there is no equation")
    return tuple(map(_equation, parts))


def _equation(text: str) -> Equation:
    left, equal, right = text.partition("=")
    if not equal or not re.fullmatch(r"\s*[^\W\d]\w*\s*", left):
        raise EquationError(f"{text.strip()!r}: expected a name, =, and a right side")
    try:
        tree = ast.parse(" ".join(_spelled(right)), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise EquationError(f"{text.strip()!r} cannot be read: {error}") from error
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return Equation(left.strip(), frozenset(names - set(_FUNCTIONS) - {"pi"}), tree)


def _spelled(text: str) -> Iterator[str]:
    """Tokens of an expression, with every multiplication sign inserted."""
    at, before = 0, ""
    text = text.strip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise EquationError(f"{text!r}: {text[at]!r} is not understood")
        word, at = match.group(match.lastgroup or 0), match.end()
        opens = match.lastgroup in ("number", "name") or word == "("
        closed = bool(before) and (before[-1].isalnum() or before[-1] in "_.)")
        if opens and closed and not (word == "(" and before in _FUNCTIONS):
            yield "*"
        before = word
        yield "**" if word == "^" else word


def _value(node: ast.expr, known: Mapping[str, Array]) -> Array:
    match node:
        case ast.Constant(value=int() | float() as number):
            return np.asarray(float(number))
        case ast.Name(id="pi"):
            return np.asarray(np.pi)
        case ast.Name(id=name):
            if name not in known:
                raise EquationError(f"{name!r} is neither a variable nor a value")
            return np.asarray(known[name], dtype=float)
        case ast.UnaryOp(op=ast.USub(), operand=one):
            return -_value(one, known)
        case ast.UnaryOp(op=ast.UAdd(), operand=one):
            return _value(one, known)
        case ast.BinOp(left=a, op=sign, right=b) if type(sign) in _TWO:
            return _TWO[type(sign)](_value(a, known), _value(b, known))
        case ast.Compare(left=a, ops=[sign], comparators=[b]) if type(sign) in _TWO:
            return 1.0 * _TWO[type(sign)](_value(a, known), _value(b, known))
        case ast.Call(func=ast.Name(id=name), args=of, keywords=[]) if name in _FUNCTIONS:
            try:
                return _FUNCTIONS[name](*(_value(one, known) for one in of))
            except TypeError as error:
                raise EquationError(f"{name} of {len(of)} arguments: {error}") from error
    raise EquationError(f"{ast.unparse(node)!r} is not allowed")
