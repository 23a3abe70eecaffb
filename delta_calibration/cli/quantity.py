"""Numbers on the command line: finite ones, between two bounds."""

from __future__ import annotations

import math
from typing import Any

import click

from delta_calibration import bounds


class Quantity(click.FloatRange):
    """A number between two finite bounds.

    Every option that is a number with a unit has this type. A range alone accepts `nan`, because
    comparisons with it are false, and an absurdly large number would overflow when squared.
    """

    name = "number"

    def __init__(self, least: float, most: float, *, above: bool = False) -> None:
        """From the bounds; `above` leaves out the lower one."""
        super().__init__(min=least, max=most, min_open=above)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert the text to a number.

        Raises:
            click.BadParameter: no number, not finite, or out of range; says what is allowed.
        """
        number = float(click.FLOAT.convert(value, param, ctx))
        if not math.isfinite(number):
            allowed = self._describe_range()
            self.fail(f"{value} is not a finite number; allowed: {allowed}", param, ctx)
        return super().convert(number, param, ctx)


class OfPart(click.ParamType):  # type: ignore[type-arg]
    """`PART=NUMBER`: a quantity of a named part."""

    name = "part"

    def __init__(self, quantity: Quantity, example: str) -> None:
        """From the quantity, and an example of the form for the error message."""
        self._quantity, self._example = quantity, example

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """Convert the text to part and number.

        Raises:
            click.BadParameter: of another form, or a number that is not allowed.
        """
        if isinstance(value, tuple):
            return value
        part, _, text = str(value).partition("=")
        if not part or not text:
            form = str(param.metavar) if isinstance(param, click.Option) else "PART=NUMBER"
            self.fail(f"{value}: {form} is expected, such as {self._example}", param, ctx)
        return part, float(self._quantity.convert(text, param, ctx))


MASS = Quantity(*bounds.PAYLOAD)  # [kg]
CELSIUS = Quantity(*bounds.CELSIUS)  # [deg C]
