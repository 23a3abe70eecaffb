"""Rods that stretch under the force they carry.

dl = N(pose, payload) / k
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.rods import lengthened, tensions
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class ForearmCompliance(Effect):
    """Elastic stretch of each rod, all of one stiffness."""

    cause: ClassVar[str] = "forearm_compliance"
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether its loads are known: those of a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)

    @property
    def parameters(self) -> ParameterSet:
        """1/k of a rod [m/N]: k is 1 to 10 N/um."""
        return self.shared("rod_compliance", "m/N", 3e-7, 0.0, 1e-4)

    def columns(self, at: Conditions) -> Array:
        """(n, p, 1) [N]."""
        a, b = tensions(self.robot, self.mechanism, at)
        return lengthened(self.mechanism, a, b)[:, :, None]
