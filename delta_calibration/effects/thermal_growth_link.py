"""Links of a serial arm that grow with their temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array
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

    def lengths(self) -> Array:
        """Lengths and offsets as drawn, (p,) [m]; zeros if the mechanism is not an arm."""
        arm = self.mechanism
        return arm.drawn_along if isinstance(arm, SerialArm) else np.zeros(len(arm.parameters))
