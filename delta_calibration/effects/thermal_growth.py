"""Thermal growth of parts.

    dL = alpha L (T - 20 deg C)        with a temperature sensor, or
    dL = growth L (1 - exp(-t / tau))  if no sensor follows the warming, or
    dL = growth L (sin 2 pi (t / P + phase) - sin 2 pi phase)    if it goes up and down

20 deg C is the standard reference temperature (ISO 1), at which the part has its nominal length.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, cast

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import SENSOR, Array, Effect, Interval, Limits, Setting, Stage
from delta_calibration.effects.regressor import CLOCK, Regressor, temperature
from delta_calibration.effects.signals import TIME, Places, Signals
from delta_calibration.effects.time_course import (
    CYCLE,
    TIME_CONSTANTS,
    TOLD,
    WARM_UP,
    around,
    course,
    cycles,
    is_ramp,
    kind_of,
    wrong_cycle,
)
from delta_calibration.model.symbols import Symbol, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet

REFERENCE = 20.0  # [deg C]
_WARMING = 0.5  # [K] a sensor whose temperature varies less is of no use
_BEHIND = 60.0  # [s] assumed standard deviation of a sensor's delay behind its part
_ALONE = 4.0  # how many times rarer one part grows alone than all alike; an assumption
_AROUND = 150.0  # [s] before and after a sample, over which the warming rate is averaged


@dataclass(frozen=True)
class Growth(Effect):
    """Growth of a part as it warms: by its own sensor, another one, or the clock."""

    kind: ClassVar[str] = "structure"
    needs: ClassVar[tuple[str, ...]] = ("temperature",)
    part: ClassVar[str]
    many: ClassVar[bool] = True  # whether a machine has several such parts, one at each joint
    told: ClassVar[Mapping[str, tuple[str, str]]] = TOLD
    limits: ClassVar[Limits] = {"time_constant": (0.0, 1e9), **CYCLE, "alike": (0.0, 1.0)}
    one_of: ClassVar[tuple[str, ...]] = (SENSOR, "time_constant", "period")
    valley: ClassVar[bool] = True  # of period and phase: data fix the phase at mid-time
    either_sign: ClassVar[bool] = False  # a cell that warms up does not shrink

    sensor: str = ""  # part whose temperature is used; empty: growth follows time
    time_constant: float = 0.0  # [s] of the warming over time
    period: float = 0.0  # [s] of the room's temperature; 0: no cycle
    phase: float = 0.0  # of the cycle, as a share of its period
    alike: float = 1.0  # 1: all such parts grow alike; 0: each has its own growth

    @property
    def parameters(self) -> ParameterSet:
        """alpha [1/K], at most 30e-6 for a metal; or the whole growth [1] over time."""
        if self.sensor:
            return self.shared("expansion", "1/K", 15e-6, 0.0, 40e-6)
        return self.shared("growth", "1", 150e-6, -1e-3, 1e-3)

    def regressor(self, at: Conditions) -> Regressor:
        """The sensor's temperature, or time."""
        del at
        return temperature(self.sensor) if self.sensor else CLOCK

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """The part's own thermometer; growth over time if it has none."""
        if self.part in thermometers:
            return {SENSOR: self.part}
        return {"time_constant": WARM_UP}

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Its own sensor; else every other sensor that varies, warming over time, and cycles."""
        if self.part in at.temperature_parts:
            yield self._over(sensor=self.part)
            return
        for sensor in at.temperature_parts:
            if np.ptp(at.of_part(sensor)) >= _WARMING:
                yield self._over(sensor=sensor)
        for constant in TIME_CONSTANTS:
            yield self._over(time_constant=constant)
        for period, phase in cycles(at):
            yield self._over(period=period, phase=phase)

    def _over(self, sensor: str = "", **course: float) -> Growth:
        """The effect that follows a sensor, or a course over time."""
        plain = {"time_constant": 0.0, "period": 0.0, "phase": 0.0}
        shape: dict[str, Any] = {**plain, **course}
        return replace(self, sensor=sensor, **shape)

    @property
    def per_hour(self) -> bool:
        """Whether growth follows time as a ramp."""
        return not self.sensor and is_ramp(self.time_constant, period=self.period)

    @property
    def follows(self) -> str:
        """The temperature of a sensor; over time a ramp, settling or a cycle."""
        if self.sensor:
            return f"the temperature of {self.sensor}"
        return kind_of(self.time_constant, period=self.period)

    def intervals(self) -> tuple[Interval, ...]:
        """Intervals of the searched fields, if the growth follows time."""
        if self.sensor:
            return ()
        return around(self.time_constant, period=self.period, phase=self.phase)

    @property
    def question(self) -> Hashable:
        """Whether all parts grow alike, by one value, or each by its own."""
        return self.alike

    @property
    def rarity(self) -> float:
        """Growth of one part alone, or of each by itself, is rarer than that of all alike."""
        return 1.0 if self.alike else _ALONE

    def wrong(self) -> str:
        """Also check the cycle, and that parts grow alike or not."""
        allowed, said = ((0.0, 1.0), "0 or 1") if self.many else ((1.0,), "1")
        alike = self.alike in allowed
        other = "" if alike else f"alike {self.alike:g} is not allowed; {said}"
        return super().wrong() or wrong_cycle(self.period, self.phase) or other

    @property
    def bound_to_session(self) -> bool:
        """Whether growth follows time; with a sensor it stays valid."""
        return not self.sensor

    @property
    def lasting(self) -> bool:
        """Whether the part stays as warm as at the session's end: not where it follows a cycle."""
        return not self.period

    def doubt(self) -> Effect | None:
        """Effect of a sensor's delay behind its part, which is not known; None over time."""
        if not self.sensor:
            return None
        of_stage = _DriveBehind if self.stage is Stage.DRIVE else _Behind
        return of_stage(self.robot, self.mechanism, self)

    def _warms(self, places: Places) -> tuple[int, float]:
        """Signal that the warming follows; and 1, or NaN if it is a sensor that does not exist."""
        if not self.sensor:
            return places.begin(TIME), 1.0
        return places.temperature(self.sensor), 1.0 if self.sensor in places.parts else np.nan

    @property
    def _course(self) -> tuple[float, ...]:
        """Constants of `warming`."""
        return float(bool(self.sensor)), self.time_constant, self.period, self.phase


def warming(signal: Symbol, c: Symbol) -> Symbol:
    """T - 20 deg C of a sensor, or h(time), by the four constants of a `Growth`."""
    return where(c[0] > 0, signal - REFERENCE, course(signal, c[1], -1.0, c[2], c[3]))


@dataclass(frozen=True)
class ThermalGrowth(Growth):
    """Growth of a part's dimensions, each in proportion to its length."""

    stage: ClassVar[Stage] = Stage.STRUCTURE

    @abstractmethod
    def lengths(self) -> Array:
        """Length of the part contained in each geometry parameter, (p,) [m]."""

    @property
    def parameters(self) -> ParameterSet:
        """alpha [1/K], or the whole growth [1] over time, of all parts or of each."""
        (shared,) = super().parameters
        if self.alike:
            return ParameterSet((shared,))
        each = {place: place.rpartition("_")[2] for place in self._places}
        return ParameterSet(
            tuple(
                replace(shared, name=f"{shared.name}_{number}", location=place)
                for place, number in each.items()
            )
        )

    @property
    def _places(self) -> tuple[str, ...]:
        """Joints that have such a part, in the order of their dimensions."""
        each = zip(self.mechanism.parameters, self.lengths(), strict=True)
        return tuple(dict.fromkeys(p.location for p, length in each if length and p.location))

    def wrong(self) -> str:
        """Also check that the mechanism says at which joints such parts are."""
        nowhere = not self.alike and not self._places
        return super().wrong() or ("alike 0 is not allowed; no joint has such a part" * nowhere)

    @property
    def at_one_place(self) -> bool:
        """Whether one part alone grows, and the others like it do not.

        Several growths at once could imitate any drift of the joints' zeros.
        """
        return not self.alike

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Each shape of growth, of all parts alike and of one alone.

        The temperature of a room, which goes up and down, makes all parts grow alike.
        """
        several = self.many and len(self._places) > 1
        for shape in cast("Iterator[Growth]", super().shapes(at)):
            yield replace(shape, alike=1.0)
            if several and not shape.period:
                yield replace(shape, alike=0.0)

    @property
    def suits(self) -> bool:
        """Whether any dimension of the mechanism belongs to the part."""
        return bool(self.lengths().any())

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """alpha L (T - 20 deg C), or growth L h(time), of one dimension."""
        return v[0] * c[0] * warming(s[0], c[1:5])

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per dimension that grows; NaN if its sensor was not recorded."""
        signal, known = self._warms(places)
        lengths, parts, dimensions = self.lengths(), self._places, self.mechanism.parameters.items
        for row in np.flatnonzero(lengths).tolist():
            place = dimensions[row].location
            if self.alike or place:
                value = 0 if self.alike or place is None else parts.index(place)
                of = known * float(lengths[row])
                yield Term((signal,), (value,), (row,), (of, *self._course))

    def nominal_of(self, cause: str) -> Array:
        """Nominal values of the parameters of a cause, 0 elsewhere, (p,) [m]."""
        parameters = self.mechanism.parameters
        return np.where([p.cause == cause for p in parameters], parameters.nominal, 0.0)


@dataclass(frozen=True)
class _Behind(Effect):
    """Growth that a sensor misses because it lags behind the warming of its part."""

    cause: ClassVar[str] = "sensor_behind"
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE

    growth: Growth

    @property
    def parameters(self) -> ParameterSet:
        """Parameters of the growth."""
        return self.growth.parameters

    def columns_of(
        self, signals: Signals, values: Array | None = None, by_stage: Array | None = None
    ) -> Array:
        """See `Effect.columns_of`; needs whole sessions, to know how fast a part warms."""
        clock = signals.of(TIME)[:, 0]
        order = np.argsort(clock)
        begin = signals.places.temperature(self.growth.sensor)
        time, celsius = clock[order], signals.rows[order, begin]
        ends = np.clip(clock + np.array([[-_AROUND], [_AROUND]]), time[0], time[-1])
        rise, span = np.diff(np.interp(ends, time, celsius), axis=0)[0], np.ptp(ends, axis=0)
        rate = np.divide(rise, span, out=np.zeros_like(rise), where=span > 0)
        rows = signals.rows.copy()
        rows[:, begin] = REFERENCE + _BEHIND * rate
        return self.growth.columns_of(replace(signals, rows=rows), values, by_stage)


@dataclass(frozen=True)
class _DriveBehind(_Behind):
    """The same of growth that moves the joints."""

    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
