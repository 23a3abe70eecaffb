"""Eccentricity of an encoder's code disc.

dq = a sin q + b cos q        amplitude 412 e/D arc seconds: eccentricity e in um, diameter D in mm
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.demo import Demo
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import JOINT
from delta_calibration.model.symbols import Symbol, cos, sin
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class EncoderEccentricity(Effect):
    """Error of one cycle per turn of the joint."""

    cause: ClassVar[str] = "encoder_eccentricity"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "encoder",
        "centre the disc of the encoder on its shaft, or compensate",
        "turn the joint once and compare with a second reading head opposite the first",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    demo: ClassVar[Demo | None] = Demo("identify", 40, general=True)
    live_strength: ClassVar[float] = 1.5

    @property
    def suits(self) -> bool:
        """Whether the joints turn."""
        return self.mechanism.joint_unit == "rad"

    @property
    def parameters(self) -> ParameterSet:
        """a and b of each joint [rad]."""
        return self.waves(0.2e-3, 0.02)

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """a sin q + b cos q."""
        del c
        return v[0] * sin(s[0]) + v[1] * cos(s[0])
