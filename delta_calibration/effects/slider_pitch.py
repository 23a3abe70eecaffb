"""A slider's screw whose thread is cut a little too long or too short.

dq = s q
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array, Effect, Stage, diagonal
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class SliderPitch(Effect):
    """Each slider goes farther than it says, in proportion to where it stands.

    For mechanisms whose joints are lengths. The same column as a wrong gear ratio; what is typical
    and what is possible are a screw's.
    """

    cause: ClassVar[str] = "slider_pitch"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE

    @property
    def suits(self) -> bool:
        """Whether the joints slide."""
        return self.mechanism.joint_unit == "m"

    @property
    def parameters(self) -> ParameterSet:
        """s of each slider [1]: some hundredths of a millimetre over the travel."""
        return self.each_joint("pitch", "1", 50e-6, -2e-3, 2e-3)

    def columns(self, at: Conditions) -> Array:
        """(n, m, m) [m]."""
        return diagonal(at.joint)
