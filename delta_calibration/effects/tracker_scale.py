"""Scale error of the tracker, from wrong air data or a wrong wavelength.

dy = s y            about -1 ppm/K of wrong air temperature, +0.27 ppm/hPa of wrong pressure
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.regressor import DISTANCE, Regressor
from delta_calibration.effects.remedy import MEASURE, Remedy
from delta_calibration.effects.signals import READING
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class TrackerScale(Effect):
    """Every distance from the tracker reads too long by the share s."""

    cause: ClassVar[str] = "tracker_scale"
    remedy: ClassVar[Remedy] = Remedy(
        MEASURE,
        "tracker",
        "have the scale of the tracker checked, and measure again",
        "measure a scale bar",
    )
    kind: ClassVar[str] = "measurement"
    stage: ClassVar[Stage] = Stage.MEASUREMENT
    outside: ClassVar[str] = "measure a scale bar, or the robot from a second tracker station"

    @property
    def parameters(self) -> ParameterSet:
        """s [1]: tens of ppm at the worst."""
        return self.shared("scale", "1", 20e-6, -1e-3, 1e-3)

    def regressor(self, at: Conditions) -> Regressor:
        """Distance from the tracker."""
        del at
        return DISTANCE

    takes: ClassVar[tuple[str, ...]] = (READING,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """s y."""
        del c
        return v[0] * s[0:3]
