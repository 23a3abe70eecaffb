"""A drive that gives way under what it carries: one spring, for weight and inertia alike.

dq = -tau / k        tau = dU/dq + J^T M a

of arms, rods, platform and payload (model/loads.py). At rest it is their weight alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.regressor import Groups, Regressor, by_payload
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import GRAVITY, INERTIA
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class JointCompliance(Effect):
    """Elastic twist of each drive behind its encoder."""

    cause: ClassVar[str] = "joint_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drives",
        "compensate the drives' give, or make them stiffer",
        "hang a known weight on the arm with the motor held and read a dial gauge at its end",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    gentle: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether its loads are known: those of a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)

    @property
    def parameters(self) -> ParameterSet:
        """1/k of each joint [rad/(N m)]: k is 25 000 to 44 000 N m/rad."""
        return self.each_joint("compliance", "rad/(N m)", 4e-5, 0.0, 1e-2)

    def regressor(self, at: Conditions) -> Regressor:
        """Torque on the joint, of the nominal machine."""
        del at
        return Regressor("torque of weight and inertia on the joint [N m]", self._torque)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """By payload."""
        del joint
        return by_payload(at)

    takes: ClassVar[tuple[str, ...]] = (GRAVITY, INERTIA)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-tau / k."""
        del c
        return -v[0] * (s[0] + s[1])

    def _torque(self, at: Conditions, joint: int) -> Array:
        """About one joint, (n,) [N m]."""
        signals = self.nominal(at)
        return signals.of(GRAVITY)[:, joint] + signals.of(INERTIA)[:, joint]
