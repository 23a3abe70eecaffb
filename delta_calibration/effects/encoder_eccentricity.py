"""A code disc off its axis.

dq = a sin q + b cos q        412 e/D arc seconds, e in um, D in mm
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Stage, diagonal
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class EncoderEccentricity(Effect):
    """One cycle a turn of the joint."""

    cause: ClassVar[str] = "encoder_eccentricity"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE

    @property
    def suits(self) -> bool:
        """Whether the joints turn."""
        return self.mechanism.joint_unit == "rad"

    @property
    def parameters(self) -> ParameterSet:
        """a and b of each joint [rad]."""
        sine = self.each_joint("sine", "rad", 0.2e-3, -0.02, 0.02)
        return sine + self.each_joint("cosine", "rad", 0.2e-3, -0.02, 0.02)

    def columns(self, at: Conditions) -> Array:
        """(n, m, 2 m)."""
        parts = [diagonal(np.sin(at.joint)), diagonal(np.cos(at.joint))]
        return np.concatenate(parts, axis=-1)
