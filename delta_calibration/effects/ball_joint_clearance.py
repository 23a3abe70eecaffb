"""Ball joints with play: a rod is longer by the clearance when pulled, shorter when pushed.

    dl = c tanh(N / N_0)

The surface where the force N changes its sign is a step in the workspace, as wide as the force N_0
takes by which contact and friction let go of one side; 0 is a sharp one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Interval, Limits, Stage
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

    limits: ClassVar[Limits] = {"force": (0.0, 1e3)}

    force: float = 0.0

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
        sides = (self._side(pull) for pull in tensions(self.robot, self.mechanism, at))
        return lengthened(self.mechanism, *sides)[:, :, None]

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A sharp step, and wider ones [N]."""
        del at
        for force in (0.0, 0.2, 0.8):
            yield replace(self, force=force)

    def intervals(self) -> tuple[Interval, ...]:
        """Between the neighbours of the search; a sharp step is one."""
        return (("force", self.force / 2, 2 * self.force),) if self.force else ()

    def _side(self, pull: Array) -> Array:
        """Where in its clearance a rod sits, -1 pushed to 1 pulled."""
        return np.tanh(pull / self.force) if self.force else np.sign(pull)
