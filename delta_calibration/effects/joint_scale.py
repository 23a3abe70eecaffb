"""Scale error of a joint, from a wrong gear ratio or wrong counts per turn.

dq = s q
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import JOINT
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class JointScale(Effect):
    """Each joint moves farther than its reading, in proportion."""

    cause: ClassVar[str] = "joint_scale"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "drive's settings",
        "enter the true gear ratio or counts per turn",
        "turn the motor ten times and measure how far the joint has moved",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    simplest: ClassVar[tuple[str, str]] = ("q", "line")

    @property
    def suits(self) -> bool:
        """Whether the joints turn; for sliders see `slider_pitch`, for cables `drum_scale`."""
        return self.mechanism.joint_unit == "rad" and self.mechanism.limb == "joint"

    @property
    def parameters(self) -> ParameterSet:
        """s of each joint [1]."""
        return self.each_joint("scale", "1", 200e-6, -0.05, 0.05)

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """s q, from the place where the reading is true."""
        return v[0] * (s[0] - c[0])

    def constants(self, joint: int) -> tuple[float, ...]:
        """Drive reading at that place: the mechanism's own zero."""
        return (float(self.mechanism.drives.zero[joint]),)
