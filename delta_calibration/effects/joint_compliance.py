"""A drive that gives way under the weight it carries.

dq = -tau(q, payload) / k        tau = dU/dq
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array, Effect, Stage, diagonal
from delta_calibration.effects.loads import gravity_torque
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class JointCompliance(Effect):
    """Elastic twist of each drive behind its encoder."""

    cause: ClassVar[str] = "joint_compliance"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether its loads are known: those of a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)

    @property
    def parameters(self) -> ParameterSet:
        """1/k of each joint [rad/(N m)]: k is 25 000 to 44 000 N m/rad."""
        return self.each_joint("compliance", "rad/(N m)", 4e-5, 0.0, 1e-2)

    def columns(self, at: Conditions) -> Array:
        """(n, m, m) [N m]."""
        return diagonal(-gravity_torque(self.robot, self.mechanism, at))
