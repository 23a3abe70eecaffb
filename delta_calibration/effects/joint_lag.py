"""Servo lag: a joint trails its command in motion.

dq = -T dq/dt + T^2 d2q/dt2
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.delay import Delay, ThirdTerm
from delta_calibration.effects.regressor import VELOCITY, Regressor
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import ACCELERATION, RATE
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class JointLag(Delay):
    """Each joint follows its command through a filter of first order with the time constant T."""

    cause: ClassVar[str] = "joint_lag"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "drive's controller",
        "raise the gain of the position loop, or add speed feed-forward",
        "compare commanded and actual angle in a trace of the drive",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    simplest: ClassVar[tuple[str, str]] = ("rate", "line")
    takes: ClassVar[tuple[str, ...]] = (RATE, ACCELERATION)

    second_order: float = 1.0

    @property
    def parameters(self) -> ParameterSet:
        """T of each joint [s]."""
        return self.each_joint("lag", "s", 5e-3, 0.0, 0.2)

    def regressor(self, at: Conditions) -> Regressor:
        """Speed of the joint."""
        del at
        return VELOCITY

    def doubt(self) -> Effect:
        """The third term of the series."""
        return _ThirdTerm(self.robot, self.mechanism, self)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-T dq/dt + b T^2 d2q/dt2, one T of the second term being a constant."""
        return v[0] * (c[0] * s[1] - s[0])


@dataclass(frozen=True)
class _ThirdTerm(ThirdTerm):
    stage: ClassVar[Stage] = Stage.DRIVE
