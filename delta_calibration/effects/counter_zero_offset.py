"""Homing error of a winch: its counter does not read zero with the platform at home.

dq = z

The error is constant, while a drift grows. If the robot file has a tolerance of the zeros
(`tolerances.zero_mm`), they are dimensions of every calibration and no cause.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.mechanisms import CableRobot
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class CounterZeroOffset(Effect):
    """Each counter is off by a constant angle."""

    cause: ClassVar[str] = "counter_zero_offset"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "counters",
        "home the winches again, or give the robot file a tolerance of the zeros (zero_mm)",
        "bring the platform to its home and read the counters",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    takes: ClassVar[tuple[str, ...]] = ()

    @property
    def suits(self) -> bool:
        """Whether there are cables whose zeros are no dimensions."""
        return isinstance(self.mechanism, CableRobot) and not self.mechanism.free_zeros

    @property
    def parameters(self) -> ParameterSet:
        """Angle z by which each counter is off [rad]; its usual size is 0.3 mm of cable."""
        return self.each_joint("offset", "rad", 1e-3, -0.2, 0.2)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """z."""
        del s, c
        return v[0]
