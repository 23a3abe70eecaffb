"""A base that grows with its temperature and carries motors, guides or anchors outward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.thermal_growth import ThermalGrowth


@dataclass(frozen=True)
class ThermalGrowthBase(ThermalGrowth):
    """A base that grows with its temperature and carries motors, guides or anchors outward."""

    cause: ClassVar[str] = "thermal_growth_base"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "base",
        "compensate with the temperature, or let the machine warm up first",
        "repeat ten poses cold and warm: the base grows with its temperature",
    )
    part: ClassVar[str] = "base"
    many: ClassVar[bool] = False

    def lengths(self) -> Array:
        """Nominal lengths that grow with the part, 0 elsewhere, (p,) [m]."""
        return self.mechanism.base_lengths
