"""What effects of parts that give way under loads have in common.

dq = -tau / k        tau = dU/dq + J^T M a

of a drive, by the torque of the weight that it holds and of the inertia that it accelerates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.signals import GRAVITY, INERTIA
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet

GIVE, MOST_GIVE = 4e-5, 1e-2  # [rad/(N m)] 1/k of a drive: expected, and of the softest


@dataclass(frozen=True)
class DeltaLoadEffect(Effect):
    """Base of the effects of the loads in a rotary Delta."""

    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether its loads are known: those of a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)


@dataclass(frozen=True)
class DriveCompliance(Effect):
    """Base of the elastic twist of each drive behind its encoder."""

    stage: ClassVar[Stage] = Stage.DRIVE
    gentle: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    takes: ClassVar[tuple[str, ...]] = (GRAVITY, INERTIA)

    @property
    def parameters(self) -> ParameterSet:
        """1/k of each joint [rad/(N m)]: drives and reducers have 1e4 to 1e5 N m/rad."""
        return self.each_joint("compliance", "rad/(N m)", GIVE, 0.0, MOST_GIVE)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-tau / k, of weight and of inertia."""
        del c
        return -v[0] * (s[0] + s[1])
