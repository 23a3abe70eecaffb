"""Screws of sliding joints that grow with their temperature, from their fixed bearing.

    dq = alpha (q - b) (T - 20 deg C)      or growth (q - b) h(time)

The bearing at b holds the screw, whose other end is free to move. The nut warms each screw by its
own work: feed axes of machine tools without linear scales lose tens of micrometres in this way
within an hour (ISO 230-3, thermal distortion caused by moving linear axes).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar, cast

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Stage
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import JOINT, TIME, Places
from delta_calibration.effects.slider_pitch import drive_reading, travel
from delta_calibration.effects.thermal_growth import Growth, warming
from delta_calibration.effects.time_course import TOLD
from delta_calibration.model.symbols import Symbol
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class ThermalGrowthScrew(Growth):
    """Each carriage moves away from the fixed bearing of its screw as the screw warms."""

    cause: ClassVar[str] = "thermal_growth_screw"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "screws",
        "compensate with the temperature, let the machine warm up first, or fit linear scales",
        "move a carriage to both ends of its travel, cold and warm, along a linear scale",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    part: ClassVar[str] = "screw"
    takes: ClassVar[tuple[str, ...]] = (JOINT, TIME)
    limits: ClassVar[Limits] = {**Growth.limits, "bearing": (-10.0, 10.0)}
    told: ClassVar[Mapping[str, tuple[str, str]]] = {**TOLD, "bearing": ("fixed_at_m", "m")}

    bearing: float = 0.0  # [m] place of the fixed bearing, from the mechanism's own zero

    @property
    def suits(self) -> bool:
        """Whether the joints slide."""
        return self.mechanism.joint_unit == "m"

    @property
    def parameters(self) -> ParameterSet:
        """alpha [1/K], or the whole growth [1] over time, of all screws or of each."""
        if self.alike:
            return super().parameters
        if self.sensor:
            return self.each_joint("expansion", "1/K", 15e-6, 0.0, 40e-6)
        return self.each_joint("growth", "1", 150e-6, -1e-3, 1e-3)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """alpha (q - b) (T - 20 deg C), or growth (q - b) h(time)."""
        return v[0] * (s[0] - c[0]) * warming(s[1], c[1:5])

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per screw; NaN if its sensor was not recorded."""
        signal, known = self._warms(places)
        for j in range(self.mechanism.joints):
            fixed = known * drive_reading(self.mechanism, j, self.bearing)
            value = 0 if self.alike else j
            yield Term((places.begin(JOINT) + j, signal), (value,), (j,), (fixed, *self._course))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Each shape of thermal growth, with the bearing at one end of the travel or the other.

        What makes all parts of a room go up and down makes all screws do so alike.
        """
        shapes = tuple(cast("Iterator[ThermalGrowthScrew]", super().shapes(at)))
        ends = travel(self.robot, self.mechanism)
        for alike in (1.0, 0.0):
            for shape, end in product(shapes, ends):
                if alike or not shape.period:
                    yield replace(shape, bearing=end, alike=alike)

    @property
    def chosen(self) -> dict[str, str]:
        """Whether all screws grow alike."""
        return {"screws": "all grow alike"} if self.alike else {}

    def intervals(self) -> tuple[Interval, ...]:
        """Also the bearing, within half a travel of either end of the travel.

        Growth from a bearing far away would be a drift of the zero.
        """
        low, high = travel(self.robot, self.mechanism)
        around = (high - low) / 2
        return (*super().intervals(), ("bearing", low - around, high + around))
