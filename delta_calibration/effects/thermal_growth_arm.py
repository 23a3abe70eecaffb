"""Upper arms that grow with their temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.thermal_growth import ThermalGrowth


@dataclass(frozen=True)
class ThermalGrowthArm(ThermalGrowth):
    """Upper arms that grow with their temperature."""

    cause: ClassVar[str] = "thermal_growth_arm"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "arms",
        "compensate with the temperature, or let the machine warm up first",
        "repeat ten poses cold and warm: arms grow with their temperature",
    )
    part: ClassVar[str] = "arm"

    def lengths(self) -> Array:
        """Nominal lengths that grow with the part, 0 elsewhere, (p,) [m]."""
        return self.nominal_of("arm_length")
