"""Links of a serial arm that grow with their temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.thermal_growth import ThermalGrowth


@dataclass(frozen=True)
class ThermalGrowthLink(ThermalGrowth):
    """Lengths and offsets of the links grow; offsets along parallel axes, as drawn, do not."""

    cause: ClassVar[str] = "thermal_growth_link"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "links",
        "compensate by temperature, or let the machine warm up first",
        "repeat ten poses cold and warm: links grow with their temperature",
    )
    part: ClassVar[str] = "link"

    def lengths(self) -> Array:
        """(p,) [m]."""
        return self.nominal_of("link_length") + self.nominal_of("link_offset")
