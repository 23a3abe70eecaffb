"""Drift of a joint's zero over time: an encoder or a coupling creeps or slips.

dq = c h(time)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Stage
from delta_calibration.effects.regressor import CLOCK, Regressor
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import TIME
from delta_calibration.effects.time_course import EITHER, LIMITS, TOLD, around, course, courses
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class JointZeroDrift(Effect):
    """Ramp or step of each joint's zero."""

    cause: ClassVar[str] = "joint_zero_drift"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "joint's zero",
        "find what slips or warms up, and home the joint again",
        "home the joint again and repeat the first ten poses: the error is gone",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    outside: ClassVar[str] = (
        "return to one reference pose every ten minutes, also while the machine cools down"
    )
    told: ClassVar[Mapping[str, tuple[str, str]]] = TOLD
    limits: ClassVar[Limits] = LIMITS
    one_of: ClassVar[tuple[str, ...]] = EITHER

    time_constant: float = 0.0  # [s]; 0: ramp
    step_at: float = -1.0  # [s]; negative: no step

    @property
    def parameters(self) -> ParameterSet:
        """c of each joint [rad]: drift per hour, of the whole settling, or of the step."""
        return self.each_joint("drift", "rad", 0.1e-3, -0.02, 0.02)

    def regressor(self, at: Conditions) -> Regressor:
        """Time."""
        del at
        return CLOCK

    takes: ClassVar[tuple[str, ...]] = (TIME,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """c h(time)."""
        return v[0] * course(s[0], c[0], c[1])

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
