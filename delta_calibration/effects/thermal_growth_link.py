"""Links of a serial arm that grow with their temperature.

The column under the arm, the first link's offset, is often another part: it stays cold while
motors warm the links. What it grows moves the whole arm along the first axis, as a drifting
tracker would.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array, Effect, Limits
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.thermal_growth import ThermalGrowth
from delta_calibration.mechanisms import SerialArm


@dataclass(frozen=True)
class ThermalGrowthLink(ThermalGrowth):
    """Growth of the links' lengths and offsets."""

    cause: ClassVar[str] = "thermal_growth_link"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "links",
        "compensate with the temperature, or let the machine warm up first",
        "repeat ten poses cold and warm: links grow with their temperature",
    )
    part: ClassVar[str] = "link"
    limits: ClassVar[Limits] = {**ThermalGrowth.limits, "column": (0.0, 1.0)}

    column: float = 1.0  # how much the column grows, relative to the links

    def lengths(self) -> Array:
        """Lengths and offsets as drawn, (p,) [m]; zeros if the mechanism is not an arm."""
        arm = self.mechanism
        if not isinstance(arm, SerialArm):
            return np.zeros(len(arm.parameters))
        return np.where(self._is_column, self.column, 1.0) * arm.drawn_along

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Each shape of thermal growth, with a column that grows and with one that does not."""
        whole = replace(self, column=1.0).lengths()
        columns = (1.0, 0.0) if whole[self._is_column].any() else (1.0,)
        for shape in cast("Iterator[ThermalGrowthLink]", super().shapes(at)):
            for column in columns if shape.alike else (1.0,):
                yield replace(shape, column=column)

    @property
    def chosen(self) -> dict[str, str]:
        """Whether the column keeps its height."""
        return {} if self.column else {"column": "does not grow"}

    @property
    def _is_column(self) -> NDArray[np.bool_]:
        """The first link's offset among the dimensions, (p,)."""
        return np.array([name == "offset_1" for name in self.mechanism.parameters.names])
