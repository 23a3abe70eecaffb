"""The functions that a law found in data may use, each with its text for people and for files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

LINE, SQUARE, CUBE, SINE, COSINE, SIDE, SOFT, BEYOND, SETTLED, DRAG, FADING, RAMP = range(1, 13)
ALONE, OTHER = 13, 14  # of two quantities: the first without the second, and the second alone


@dataclass(frozen=True)
class Form:
    """One function f(u).

    Attributes:
        of: the function, given u and the module of its operations: symbols or numpy.
        said: its text in an equation, for the text of u.
        coded: its text in an effect file, in the operations of `symbols`.
        power: power of u's unit in the unit of f; 0 where f has no unit.
    """

    of: Callable[[Any, Any], Any]
    said: str
    coded: str
    power: int = 0

    def text(self, u: str) -> str:
        """Text in an equation, with `u` in its place."""
        return self.said.replace("U", u)


FORMS: Mapping[int, Form] = {
    LINE: Form(lambda u, w: u, "U", "u", 1),
    SQUARE: Form(lambda u, w: u * u, "(U)^2", "u**2", 2),
    CUBE: Form(lambda u, w: u * u * u, "(U)^3", "u**3", 3),
    SINE: Form(lambda u, w: w.sin(u), "sin(U)", "sin(u)"),
    COSINE: Form(lambda u, w: w.cos(u), "cos(U)", "cos(u)"),
    SIDE: Form(lambda u, w: w.sign(u), "sign(U)", "sign(u)"),
    SOFT: Form(lambda u, w: w.tanh(u), "tanh(U)", "tanh(u)"),
    BEYOND: Form(lambda u, w: w.maximum(u, 0.0), "max(0, U)", "maximum(u, 0.0)", 1),
    SETTLED: Form(
        lambda u, w: 1 - w.exp(-w.maximum(u, 0.0)),
        "(1 - exp(-max(0, U)))",
        "(1.0 - exp(-maximum(u, 0.0)))",
    ),
    DRAG: Form(lambda u, w: u * w.absolute(u), "(U)*abs(U)", "u * absolute(u)", 2),
    FADING: Form(
        lambda u, w: w.exp(-w.maximum(u, 0.0)), "exp(-max(0, U))", "exp(-maximum(u, 0.0))"
    ),
    RAMP: Form(
        lambda u, w: w.minimum(w.maximum(u, 0.0), 1.0),
        "min(1, max(0, U))",
        "minimum(maximum(u, 0.0), 1.0)",
    ),
    ALONE: Form(lambda u, w: u, "U", "u", 1),
    OTHER: Form(lambda u, w: 1 + 0 * u, "1", "1.0"),
}
# functions that a law may use, each with its terms; every term has a value
FUNCTIONS: Mapping[str, tuple[int, ...]] = {
    "line": (LINE,),
    "square": (SQUARE,),
    "cube": (CUBE,),
    "quadratic": (LINE, SQUARE),
    "cubic": (LINE, SQUARE, CUBE),
    "wave": (SINE, COSINE),
    "sign": (SIDE,),
    "saturation": (SOFT,),
    "beyond": (BEYOND,),
    "settling": (SETTLED,),
    "drag": (DRAG,),
    "fading": (FADING,),
    "ramp": (RAMP,),
    "bilinear": (LINE, ALONE, OTHER),  # product of two quantities, each beside it as well
}
