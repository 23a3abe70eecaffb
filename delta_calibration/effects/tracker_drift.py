"""Drift of the tracker's stand or zero: a small rigid motion of all readings over time.

dy = (t + w x y) h(time)
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Setting, Stage
from delta_calibration.effects.regressor import CLOCK, Regressor
from delta_calibration.effects.remedy import MEASURE, Remedy
from delta_calibration.effects.signals import READING, TIME
from delta_calibration.effects.time_course import (
    EITHER,
    LIMITS,
    TOLD,
    WARM_UP,
    around,
    course,
    courses,
)
from delta_calibration.model.symbols import Symbol, cross
from delta_calibration.parameters import Parameter, ParameterSet


@dataclass(frozen=True)
class TrackerDrift(Effect):
    """Rigid drift; h a ramp, a settling with `time_constant` [s] (0 is the ramp) or a step."""

    cause: ClassVar[str] = "tracker_drift"
    remedy: ClassVar[Remedy] = Remedy(
        MEASURE,
        "tracker",
        "let the tracker warm up, fix its stand, and measure again",
        "measure a reflector that is fixed to the floor before, during and after the session",
    )
    kind: ClassVar[str] = "measurement"
    stage: ClassVar[Stage] = Stage.MEASUREMENT
    outside: ClassVar[str] = "measure three reflectors fixed to the floor, every ten minutes"
    told: ClassVar[Mapping[str, tuple[str, str]]] = TOLD
    limits: ClassVar[Limits] = LIMITS
    one_of: ClassVar[tuple[str, ...]] = EITHER
    alone: ClassVar[tuple[tuple[str, ...], ...]] = (("shift_x", "shift_y", "shift_z"),)

    time_constant: float = 0.0  # [s]
    step_at: float = -1.0  # [s]; negative: no step

    @property
    def parameters(self) -> ParameterSet:
        """Shift t [m] and turn w [rad]: per hour, of the whole settling, or of the step."""
        names = [("shift", "m", 30e-6, 2e-3), ("turn", "rad", 10e-6, 1e-3)]
        return ParameterSet(
            tuple(
                Parameter(f"{name}_{axis}", unit, 0.0, prior, self.cause, None, -most, most)
                for name, unit, prior, most in names
                for axis in "xyz"
            )
        )

    def regressor(self, at: Conditions) -> Regressor:
        """Time."""
        del at
        return CLOCK

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """Settling with the machine's warm-up, as the stand warms up with it."""
        del thermometers
        return {"time_constant": WARM_UP}

    takes: ClassVar[tuple[str, ...]] = (
        READING,
        TIME,
    )

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """(t + w x y) h(time)."""
        return (v[0:3] + cross(v[3:6], s[0:3])) * course(s[3], c[0], c[1])

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
