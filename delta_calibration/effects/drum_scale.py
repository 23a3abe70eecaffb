"""Radius error of a drum, slightly larger or smaller than drawn.

dl = s k theta
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.joint_scale import JointScale
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.mechanisms import CableRobot
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class DrumScale(JointScale):
    """Each drum lets out more cable than its counter reads, in proportion."""

    cause: ClassVar[str] = "drum_scale"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drums",
        "enter the true radius of the drums",
        "unwind ten turns from a drum and measure the length",
    )

    @property
    def suits(self) -> bool:
        """Whether the mechanism has cables."""
        return isinstance(self.mechanism, CableRobot)

    @property
    def parameters(self) -> ParameterSet:
        """s of each drum [1]."""
        return self.each_joint("scale", "1", 2e-3, -0.1, 0.1)
