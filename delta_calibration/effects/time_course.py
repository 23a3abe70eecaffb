"""Time courses of effects: a ramp, settling towards a final value, or a step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits
from delta_calibration.effects.regressor import CLOCK, Regressor
from delta_calibration.model.symbols import Symbol, exp, maximum, where

Array = NDArray[np.float64]

HOUR = 3600.0  # [s]
WARM_UP = 2400.0  # [s] time constant of a machine's warm-up after it is switched on
TOLD = {"time_constant": ("time_constant_s", "s"), "step_at": ("step_at_s", "s")}
TIME_CONSTANTS = (600.0, 1200.0, 2400.0, 4800.0)  # [s]; longer ones look like a ramp
_STEPS = 24  # a search tries fewer than twice as many step times
_NEAR = 300.0  # [s] half width of the interval about the time of a step
_LEAST = 8  # least number of times at rest on either side of a step


def course(time: Symbol, time_constant: Symbol, step_at: Symbol) -> Symbol:
    """h(time): a ramp in hours, settling from 0 to 1, or 0 before a step and 1 after it.

    Args:
        time: time since the session's start [s].
        time_constant: time constant of the settling [s]; 0 for a ramp.
        step_at: moment of the step [s]; negative for none.
    """
    settled = 1 - exp(-maximum(time, 0.0) / maximum(time_constant, 1e-9))
    smooth = where(time_constant > 0, settled, time / HOUR)
    return where(step_at >= 0, where(time >= step_at, 1.0, 0.0), smooth)


def courses(at: Conditions) -> Iterator[tuple[float, float]]:
    """Yield pairs (time constant, step) worth trying [s]; steps lie between poses at rest."""
    yield 0.0, -1.0
    for constant in TIME_CONSTANTS:
        yield constant, -1.0
    moments = np.unique(at.time[(at.velocity == 0).all(axis=1)])
    between = (moments[_LEAST:-_LEAST] + moments[_LEAST - 1 : -_LEAST - 1]) / 2
    for step in between[:: max(1, len(between) // _STEPS)].tolist():
        yield 0.0, step


def around(time_constant: float, step_at: float) -> tuple[Interval, ...]:
    """Field of the two that was searched, with an interval around it; none for a ramp."""
    if step_at >= 0:
        return (("step_at", max(0.0, step_at - _NEAR), step_at + _NEAR),)
    if time_constant > 0:
        return (("time_constant", time_constant / 2, 2 * time_constant),)
    return ()


@dataclass(frozen=True)
class Drift(Effect):
    """Base of the drifts: what they move follows h(time), the constants of their laws."""

    told: ClassVar[Mapping[str, tuple[str, str]]] = TOLD
    limits: ClassVar[Limits] = {"time_constant": (0.0, 1e9), "step_at": (-1.0, 1e9)}  # [s]
    one_of: ClassVar[tuple[str, ...]] = ("time_constant", "step_at")

    time_constant: float = 0.0  # [s]; 0: ramp
    step_at: float = -1.0  # [s]; negative: no step

    def regressor(self, at: Conditions) -> Regressor:
        """Time."""
        del at
        return CLOCK

    def constants(self, joint: int) -> tuple[float, ...]:
        """Time constant and moment of the step."""
        del joint
        return self.time_constant, self.step_at

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A ramp, settling from minutes to over an hour, and steps."""
        for constant, step in courses(at):
            yield replace(self, time_constant=constant, step_at=step)

    def intervals(self) -> tuple[Interval, ...]:
        """Interval of the time constant or of the moment of the step; none for a ramp."""
        return around(self.time_constant, self.step_at)

    @property
    def bound_to_session(self) -> bool:
        """True: a drift by the clock says nothing about another day."""
        return True
