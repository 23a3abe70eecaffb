"""Drives that give way to the inertia they accelerate.

dq = -J^T M a / k
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.loads import (
    carried_mass,
    platform_acceleration,
    pose_of,
)
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class DynamicDeflection(Effect):
    """Elastic twist of the drives under what the platform and its payload weigh in motion."""

    cause: ClassVar[str] = "dynamic_deflection"
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.DRIVE
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether its loads are known: those of a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)

    @property
    def parameters(self) -> ParameterSet:
        """1/k [rad/(N m)], the same for all joints."""
        return self.shared("dynamic_compliance", "rad/(N m)", 4e-5, 0.0, 1e-2)

    def columns(self, at: Conditions) -> Array:
        """(n, m, 1) [N m]."""
        x = pose_of(self.mechanism, at)
        nominal = self.mechanism.parameters.nominal
        by_pose = self.mechanism.point_by_pose(x, np.zeros(3))
        slope = by_pose @ self.mechanism.velocity_jacobian(at.joint, x, nominal)
        force = carried_mass(self.robot, at)[:, None] * platform_acceleration(self.mechanism, at)
        return np.asarray(-np.einsum("nk,nkm->nm", force, slope)[:, :, None])
