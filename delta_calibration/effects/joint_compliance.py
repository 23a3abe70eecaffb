"""Elastic drives: one spring per joint, loaded by weight and inertia.

dq = -tau / k        tau = dU/dq + J^T M a

of all masses in the robot file and the payload (model/loads.py). At rest only their weight acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array
from delta_calibration.effects.regressor import Groups, Regressor, by_payload
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import GRAVITY, INERTIA
from delta_calibration.effects.springs import DriveCompliance, LoadEffect


@dataclass(frozen=True)
class JointCompliance(DriveCompliance, LoadEffect):
    """Elastic twist of each drive behind its encoder."""

    cause: ClassVar[str] = "joint_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drives",
        "compensate the compliance of the drives, or make them stiffer",
        "hang a known weight on the machine with the motors held and read a dial gauge there",
    )
    kind: ClassVar[str] = "drive"

    def regressor(self, at: Conditions) -> Regressor:
        """Torque, or force, of weight and inertia on the joint of the nominal machine."""
        del at
        force = Regressor("force of weight and inertia on the joint [N]", self._load)
        return Regressor("torque of weight and inertia on the joint [N m]", self._load, force)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups by payload."""
        del joint
        return by_payload(at)

    def _load(self, at: Conditions, joint: int) -> Array:
        """Load of weight and inertia on one joint of the nominal machine, (n,) [N m, N]."""
        signals = self.nominal(at)
        return signals.of(GRAVITY)[:, joint] + signals.of(INERTIA)[:, joint]
