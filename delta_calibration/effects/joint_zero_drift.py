"""Drift of a joint's zero over time: an encoder or a coupling creeps or slips.

dq = c h(time)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Stage
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import TIME
from delta_calibration.effects.time_course import Drift, course
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class JointZeroDrift(Drift):
    """Drift of each joint's zero: a ramp, a settling, a step or a cycle."""

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

    @property
    def parameters(self) -> ParameterSet:
        """c of each joint [rad]: drift per hour, or of the settling, the step or the cycle."""
        return self.each_joint("drift", "rad", 0.1e-3, -0.02, 0.02)

    takes: ClassVar[tuple[str, ...]] = (TIME,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """c h(time)."""
        return v[0] * course(s[0], c[0], c[1], c[2], c[3])
