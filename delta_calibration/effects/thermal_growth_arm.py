"""Upper arms that grow with their temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.thermal_growth import ThermalGrowth


@dataclass(frozen=True)
class ThermalGrowthArm(ThermalGrowth):
    """Upper arms that grow with their temperature."""

    cause: ClassVar[str] = "thermal_growth_arm"
    part: ClassVar[str] = "arm"

    def lengths(self) -> Array:
        """(p,) [m]."""
        return self.nominal_of("arm_length")
