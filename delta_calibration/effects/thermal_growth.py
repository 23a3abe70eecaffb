"""Parts that grow with their temperature.

    dL = alpha L (T - 20 deg C)        by the part's own sensor, or
    dL = growth L (1 - exp(-t / tau))  where no sensor follows the warming

20 deg C is the standard reference temperature (ISO 1): there the part has its drawing's length.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Interval, Limits, Stage
from delta_calibration.effects.time_course import TIME_CONSTANTS, around, course_of
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions

REFERENCE = 20.0  # [deg C]
_WARMING = 0.5  # [K] a sensor that moves less says nothing
_BEHIND = 60.0  # [s] that a sensor may be behind its part, a standard deviation: assumed
_AROUND = 150.0  # [s] before and after, over which a rate of warming is taken


@dataclass(frozen=True)
class ThermalGrowth(Effect):
    """A part's dimensions change in proportion to themselves."""

    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE
    needs: ClassVar[tuple[str, ...]] = ("temperature",)
    part: ClassVar[str]
    limits: ClassVar[Limits] = {"time_constant": (0.0, 1e9)}

    sensor: str = ""  # whose temperature; none: by the clock
    time_constant: float = 0.0  # [s] of the warming by the clock

    @abstractmethod
    def lengths(self) -> Array:
        """What of each geometry parameter grows with the part, (p,) [m]."""

    @property
    def suits(self) -> bool:
        """Whether a dimension of the mechanism is one of the part's."""
        return bool(self.lengths().any())

    @property
    def parameters(self) -> ParameterSet:
        """alpha [1/K], at most 30e-6 for a metal; or the whole growth [1] by the clock."""
        if self.sensor:
            return self.shared("expansion", "1/K", 15e-6, 0.0, 40e-6)
        return self.shared("growth", "1", 150e-6, -1e-3, 1e-3)

    def columns(self, at: Conditions) -> Array:
        """(n, p, 1) [m K] or [m]."""
        if self.sensor:
            course = at.of_part(self.sensor) - REFERENCE
        else:
            course = course_of(at.time, self.time_constant, -1.0)
        return np.asarray(course[:, None, None] * self.lengths()[:, None])

    def missing(self, at: Conditions) -> str:
        """The sensor it goes by."""
        recorded = self.sensor in at.temperature_parts
        if self.sensor and not (recorded and np.isfinite(at.of_part(self.sensor)).all()):
            return f"the temperature of part {self.sensor!r} is not known"
        return ""

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Its own sensor; else every other sensor that moves, and warming by the clock."""
        if self.part in at.temperature_parts:
            yield replace(self, sensor=self.part, time_constant=0.0)
            return
        for sensor in at.temperature_parts:
            if np.ptp(at.of_part(sensor)) >= _WARMING:
                yield replace(self, sensor=sensor, time_constant=0.0)
        for constant in TIME_CONSTANTS:
            yield replace(self, sensor="", time_constant=constant)

    def doubt(self) -> Effect | None:
        """A sensor is behind its part by a time that nobody states."""
        return _Behind(self.robot, self.mechanism, self) if self.sensor else None

    def nominal_of(self, cause: str) -> Array:
        """Nominal values of the parameters of a cause, 0 elsewhere, (p,) [m]."""
        parameters = self.mechanism.parameters
        return np.where([p.cause == cause for p in parameters], parameters.nominal, 0.0)

    def intervals(self) -> tuple[Interval, ...]:
        """About the time constant, where the growth goes by the clock."""
        return () if self.sensor else around(self.time_constant, -1.0)

    @property
    def bound_to_session(self) -> bool:
        """Growth by the clock; by a sensor it holds on."""
        return not self.sensor


@dataclass(frozen=True)
class _Behind(Effect):
    """What grows more than its sensor says, by as much as it warms while that is behind."""

    cause: ClassVar[str] = "sensor_behind"
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE

    growth: ThermalGrowth

    @property
    def parameters(self) -> ParameterSet:
        """Those of the growth."""
        return self.growth.parameters

    def columns(self, at: Conditions) -> Array:
        """(n, p, 1) [m K], of all samples of a session."""
        order = np.argsort(at.time)
        time, celsius = at.time[order], at.of_part(self.growth.sensor)[order]
        ends = np.clip(at.time + np.array([[-_AROUND], [_AROUND]]), time[0], time[-1])
        rise, span = np.diff(np.interp(ends, time, celsius), axis=0)[0], np.ptp(ends, axis=0)
        rate = np.divide(rise, span, out=np.zeros_like(rise), where=span > 0)
        return np.asarray(_BEHIND * rate[:, None, None] * self.growth.lengths()[:, None])
