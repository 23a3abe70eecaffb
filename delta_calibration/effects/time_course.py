"""Time courses of effects: a ramp, settling towards a final value, a step, or a cycle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.data.conditions import SAME_PAYLOAD
from delta_calibration.effects.base import Effect, Interval, Limits
from delta_calibration.effects.regressor import CLOCK, Regressor
from delta_calibration.model.symbols import Symbol, exp, maximum, sin, where

Array = NDArray[np.float64]

HOUR = 3600.0  # [s]
WARM_UP = 2400.0  # [s] time constant of a machine's warm-up after it is switched on
TOLD = {
    "time_constant": ("time_constant_s", "s"),
    "step_at": ("step_at_s", "s"),
    "period": ("period_s", "s"),
    "phase": ("phase", "1"),
}
CYCLE: Limits = {"period": (0.0, 1e9), "phase": (0.0, 1.0)}  # [s], [1] of a period
TIME_CONSTANTS = (600.0, 1200.0, 2400.0, 4800.0)  # [s]; longer ones look like a ramp
_STEPS = 24  # a search tries fewer than twice as many step times
_MOVING, _APART = 48, 2.0  # most moments tried in motion; their least distance [s]
_PAUSE = 1.0  # [s] readings farther apart belong to two motions
_NEAR = 300.0  # [s] half width of the interval about the time of a step
_LEAST = 8  # least number of times at rest on either side of a step
# of the session: of a longer period it shows less than a cycle, as a settling does
_PERIODS = (1.0, 0.75, 0.5625, 0.42, 0.32, 0.24)
_PHASES = (0.25, 0.375, 0.5, 0.625)  # over half a cycle; the other half has the opposite sign
_BESIDE = 0.125  # [1] half width of the interval of the phase


def course(
    time: Symbol, time_constant: Symbol, step_at: Symbol, period: Symbol, phase: Symbol
) -> Symbol:
    """h(time): a ramp in hours, settling from 0 to 1, 0 before a step and 1 after it, or a cycle.

    A cycle is that of the room, by day and night or by its air conditioning.

    Args:
        time: time since the session's start [s].
        time_constant: time constant of the settling [s]; 0 for a ramp.
        step_at: moment of the step [s]; negative for none.
        period: of the cycle sin(2 pi (time / period + phase)) - sin(2 pi phase) [s]; 0: none.
        phase: of the cycle, as a share of its period.
    """
    settled = 1 - exp(-maximum(time, 0.0) / maximum(time_constant, 1e-9))
    begin = 2 * np.pi * phase
    turn = 2 * np.pi * time / maximum(period, 1e-9)
    smooth = where(time_constant > 0, settled, time / HOUR)
    cycle = where(period > 0, sin(turn + begin) - sin(begin), smooth)
    return where(step_at >= 0, where(time >= step_at, 1.0, 0.0), cycle)


def courses(at: Conditions) -> Iterator[tuple[float, float]]:
    """Yield pairs (time constant, step) worth trying [s]; steps lie between poses and in motions.

    A step that is off by seconds within a motion explains next to nothing of it.
    """
    yield 0.0, -1.0
    for constant in TIME_CONSTANTS:
        yield constant, -1.0
    resting = (at.velocity == 0).all(axis=1)
    moments = np.unique(at.time[resting])
    between = (moments[_LEAST:-_LEAST] + moments[_LEAST - 1 : -_LEAST - 1]) / 2
    for step in between[:: max(1, len(between) // _STEPS)].tolist():
        yield 0.0, step
    for step in _in_motion(at.time[~resting]).tolist():
        yield 0.0, step


def _in_motion(time: Array) -> Array:
    """Moments in motions [s], all equally far from the next one in time spent in motion."""
    moments = np.unique(time)
    if len(moments) < 2:
        return moments[:0]
    clock = np.cumsum(np.minimum(np.diff(moments, prepend=moments[0]), _PAUSE))
    apart = max(_APART, float(clock[-1]) / _MOVING)
    return np.asarray(moments[np.searchsorted(clock, np.arange(apart, clock[-1], apart))])


def _moments_near(step_at: float, at: Conditions) -> Array:
    """Moments in motion [s] between the two poses at rest about the time of a step."""
    resting = (at.velocity == 0).all(axis=1)
    stops = np.unique(at.time[resting])
    begin, end = (np.searchsorted(stops, step_at) + i for i in (-1, 0))
    low = stops[begin] if begin >= 0 else -np.inf
    high = stops[end] if end < len(stops) else np.inf
    moving = np.unique(at.time[~resting & (at.time > low) & (at.time < high)])
    between = (moving[1:] + moving[:-1]) / 2
    return np.asarray(between[:: 1 + len(between) // _MOVING])


def cycles(at: Conditions) -> Iterator[tuple[float, float]]:
    """Yield pairs (period [s], phase as a share of it) worth trying."""
    lasted = float(np.ptp(at.time)) if len(at) else 0.0
    if lasted > 0:
        for share in _PERIODS:
            for phase in _PHASES:
                yield share * lasted, phase


def around(
    time_constant: float, step_at: float = -1.0, period: float = 0.0, phase: float = 0.0
) -> tuple[Interval, ...]:
    """Fields of a course that were searched, with intervals around them; none for a ramp."""
    if step_at >= 0:
        return (("step_at", max(0.0, step_at - _NEAR), step_at + _NEAR),)
    if period > 0:
        low, high = phase - _BESIDE, phase + _BESIDE
        return ("period", 0.85 * period, period / 0.85), ("phase", low, high)
    if time_constant > 0:
        return (("time_constant", time_constant / 2, 2 * time_constant),)
    return ()


def is_ramp(time_constant: float, step_at: float = -1.0, period: float = 0.0) -> bool:
    """Whether a course is a ramp, whose values are per hour."""
    return time_constant <= 0 and step_at < 0 and period <= 0


def kind_of(time_constant: float, step_at: float = -1.0, period: float = 0.0) -> str:
    """Kind of a course over time, in words."""
    if step_at >= 0:
        return "a step"
    if period > 0:
        return "a cycle"
    return "settling" if time_constant > 0 else "a ramp"


def wrong_cycle(period: float, phase: float) -> str:
    """Reason why a cycle is invalid; empty if it is valid, or if there is none."""
    return f"phase: {phase} is not allowed without a period" if phase and not period else ""


@dataclass(frozen=True)
class Drift(Effect):
    """Base of the drifts: what they move follows h(time), the constants of their laws."""

    told: ClassVar[Mapping[str, tuple[str, str]]] = TOLD
    limits: ClassVar[Limits] = {"time_constant": (0.0, 1e9), "step_at": (-1.0, 1e9), **CYCLE}
    one_of: ClassVar[tuple[str, ...]] = ("time_constant", "step_at", "period")
    valley: ClassVar[bool] = True  # of period and phase: data fix the phase at mid-time
    repeats: ClassVar[bool] = True

    time_constant: float = 0.0  # [s]; 0: ramp
    step_at: float = -1.0  # [s]; negative: no step
    period: float = 0.0  # [s]; 0: no cycle
    phase: float = 0.0  # of the cycle, as a share of its period

    def regressor(self, at: Conditions) -> Regressor:
        """Time."""
        del at
        return CLOCK

    def constants(self, joint: int) -> tuple[float, ...]:
        """Time constant, moment of the step, period and phase."""
        del joint
        return self.time_constant, self.step_at, self.period, self.phase

    def jumps(self, name: str, at: Conditions) -> Array:
        """Moments of a motion at which a step can be, between the stops before and after it."""
        return _moments_near(self.step_at, at) if name == "step_at" else np.zeros(0)

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A ramp, settling from minutes to over an hour, steps, and cycles."""
        for constant, step in courses(at):
            yield replace(self, time_constant=constant, step_at=step, period=0.0, phase=0.0)
        for period, phase in cycles(at):
            yield replace(self, time_constant=0.0, step_at=-1.0, period=period, phase=phase)

    def apart(self, other: Effect) -> bool:
        """Whether both can go on at once: courses of unlike kinds, or steps minutes apart.

        A ramp and a settling are of one kind.
        """
        if not isinstance(other, Drift):
            return False
        if min(self.step_at, other.step_at) >= 0:
            return abs(self.step_at - other.step_at) > _NEAR
        return (self.step_at >= 0, self.period > 0) != (other.step_at >= 0, other.period > 0)

    @property
    def per_hour(self) -> bool:
        """Whether it is a ramp."""
        return is_ramp(self.time_constant, self.step_at, self.period)

    @property
    def follows(self) -> str:
        """A ramp, settling, a step or a cycle."""
        return kind_of(self.time_constant, self.step_at, self.period)

    def intervals(self) -> tuple[Interval, ...]:
        """Intervals of the searched fields; none for a ramp."""
        return around(self.time_constant, self.step_at, self.period, self.phase)

    def wrong(self) -> str:
        """Also check the cycle."""
        return super().wrong() or wrong_cycle(self.period, self.phase)

    def begins_with_payload(self, at: Conditions) -> bool:
        """Whether it is a step where the payload changes, once, as closely as steps are sought."""
        rows = np.flatnonzero((at.velocity == 0).all(axis=1) & np.isfinite(at.payload))
        rows = rows[np.argsort(at.time[rows], kind="stable")]
        time, payload = at.time[rows], at.payload[rows]
        changes = np.flatnonzero(np.abs(np.diff(payload)) > SAME_PAYLOAD) + 1
        if self.step_at < 0 or len(changes) != 1:
            return False
        return bool(abs(np.sum(time < self.step_at) - changes[0]) <= max(1, len(time) // _STEPS))

    @property
    def bound_to_session(self) -> bool:
        """True: a drift by the clock goes by the clock of its session."""
        return True

    @property
    def lasting(self) -> bool:
        """Whether it stays as at the session's end: ramp, settling and step do, cycles do not."""
        return not self.period
