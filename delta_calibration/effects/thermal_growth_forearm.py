"""Rods that grow with their temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.thermal_growth import ThermalGrowth


@dataclass(frozen=True)
class ThermalGrowthForearm(ThermalGrowth):
    """Rods that grow with their temperature."""

    cause: ClassVar[str] = "thermal_growth_forearm"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "forearms",
        "compensate with the temperature, or let the machine warm up first",
        "repeat ten poses cold and warm: forearms grow with their temperature",
    )
    part: ClassVar[str] = "forearm"

    def lengths(self) -> Array:
        """Nominal lengths that grow with the part, 0 elsewhere, (p,) [m]."""
        return self.nominal_of("forearm_length")
