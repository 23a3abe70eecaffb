"""Rods that grow with their temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.thermal_growth import ThermalGrowth


@dataclass(frozen=True)
class ThermalGrowthForearm(ThermalGrowth):
    """Rods that grow with their temperature."""

    cause: ClassVar[str] = "thermal_growth_forearm"
    part: ClassVar[str] = "forearm"

    def lengths(self) -> Array:
        """(p,) [m]."""
        return self.nominal_of("forearm_length")
