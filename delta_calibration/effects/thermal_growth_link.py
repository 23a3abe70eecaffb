"""Links of a serial arm that grow with their temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.thermal_growth import ThermalGrowth


@dataclass(frozen=True)
class ThermalGrowthLink(ThermalGrowth):
    """Lengths and offsets of the links grow; offsets along parallel axes, as drawn, do not."""

    cause: ClassVar[str] = "thermal_growth_link"
    part: ClassVar[str] = "link"

    def lengths(self) -> Array:
        """(p,) [m]."""
        return self.nominal_of("link_length") + self.nominal_of("link_offset")
