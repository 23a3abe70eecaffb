"""Radius error of a drum, slightly larger or smaller than drawn.

dl = s k theta
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect
from delta_calibration.effects.cables import CableEffect
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import JOINT, Places
from delta_calibration.model.symbols import Symbol
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class DrumScale(CableEffect):
    """Each drum lets out more cable than its counter reads, in proportion."""

    cause: ClassVar[str] = "drum_scale"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drums",
        "enter the true radius of the drums",
        "unwind ten turns from a drum and measure the length",
    )
    kind: ClassVar[str] = "drive"

    @property
    def parameters(self) -> ParameterSet:
        """s of each drum [1]."""
        return self.each_joint("scale", "1", 2e-3, -0.1, 0.1)

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """s theta, from the mechanism's own zero."""
        return v[0] * (s[0] - c[0])

    def constants(self, joint: int) -> tuple[float, ...]:
        """Drive reading at that zero."""
        return (float(self.mechanism.drives.zero[joint]),)

    @property
    def variant(self) -> str:
        """Empty, because the law takes nothing that differs between cable robots."""
        return ""

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per joint."""
        return Effect.terms(self, places)
