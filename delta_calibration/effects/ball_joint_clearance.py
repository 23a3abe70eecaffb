"""Ball joints with play: a rod is longer by the clearance when pulled, shorter when pushed.

dl = c sign(N)        the surface where N changes its sign is a step in the workspace
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.rods import lengthened, tensions
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class BallJointClearance(Effect):
    """The same clearance in every rod."""

    cause: ClassVar[str] = "ball_joint_clearance"
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether its loads are known: those of a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)

    @property
    def parameters(self) -> ParameterSet:
        """c [m]: 5 to 50 um."""
        return self.shared("clearance", "m", 20e-6, 0.0, 1e-3)

    def columns(self, at: Conditions) -> Array:
        """(n, p, 1)."""
        a, b = tensions(self.robot, self.mechanism, at)
        return lengthened(self.mechanism, np.sign(a), np.sign(b))[:, :, None]
