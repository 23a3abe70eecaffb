"""A drum a little larger or smaller than drawn.

dl = s k theta
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array, diagonal
from delta_calibration.effects.cables import CableEffect
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class DrumScale(CableEffect):
    """Each drum lets out more than its counter says, in proportion."""

    cause: ClassVar[str] = "drum_scale"
    kind: ClassVar[str] = "drive"

    @property
    def parameters(self) -> ParameterSet:
        """s of each drum [1]."""
        return self.each_joint("scale", "1", 2e-3, -0.1, 0.1)

    def columns(self, at: Conditions) -> Array:
        """(n, m, m) [rad]."""
        return diagonal(at.joint)
