"""A base plate that grows with its temperature and carries the motors outward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.thermal_growth import ThermalGrowth
from delta_calibration.mechanisms.delta_leg import DeltaModel


@dataclass(frozen=True)
class ThermalGrowthBase(ThermalGrowth):
    """A base plate that grows with its temperature and carries the motors outward."""

    cause: ClassVar[str] = "thermal_growth_base"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "base",
        "compensate with the temperature, or let the machine warm up first",
        "repeat ten poses cold and warm: the base grows with its temperature",
    )
    part: ClassVar[str] = "base"

    @property
    def suits(self) -> bool:
        """Whether the mechanism is a rotary Delta, which has such a plate."""
        return isinstance(self.mechanism, DeltaModel)

    def lengths(self) -> Array:
        """Nominal lengths that grow with the part, 0 elsewhere, (p,) [m]."""
        names = self.mechanism.parameters.names
        radial = [name.startswith(("base_radial", "joint_radial")) for name in names]
        return np.where(radial, self.robot.dimensions.base_radius, 0.0)
