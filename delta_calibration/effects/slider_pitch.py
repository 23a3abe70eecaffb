"""Pitch error of a slider's screw.

dq = s q
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.demo import Demo
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import JOINT
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class SliderPitch(Effect):
    """Each slider moves farther than its reading, in proportion to its position.

    For mechanisms whose joints are lengths. The column is that of a wrong gear ratio; the expected
    size and the bounds are those of a screw.
    """

    cause: ClassVar[str] = "slider_pitch"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "screw",
        "enter the true pitch of the screw",
        "drive the carriage over its whole travel along a linear scale",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    demo: ClassVar[Demo | None] = Demo("identify", 24)

    @property
    def suits(self) -> bool:
        """Whether the joints slide."""
        return self.mechanism.joint_unit == "m"

    @property
    def parameters(self) -> ParameterSet:
        """s of each slider [1]: a few hundredths of a millimetre over the travel."""
        return self.each_joint("pitch", "1", 50e-6, -2e-3, 2e-3)

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """s q, from the mechanism's own zero."""
        return v[0] * (s[0] - c[0])

    def constants(self, joint: int) -> tuple[float, ...]:
        """Drive reading at that zero."""
        return (float(self.mechanism.drives.zero[joint]),)
