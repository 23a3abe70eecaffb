"""Layers of cable on a drum: the effective radius falls as cable leaves it.

    d(r^2)/d(length wound) = c        2 r dr = -c r dphi        r = r_0 - c phi / 2

so that a drum turned by phi has let out r_0 phi - c phi^2 / 4: a spiral. c [m^2/m] is the cable's
cross-section, spread over the drum's width, over pi. r_0 is the drawing's, c in proportion to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.cables import CableEffect, cable
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


def let_out(turn: Symbol, radius: Symbol, build_up: Symbol) -> Symbol:
    """Length [m] let out by a drum turned by `turn` [rad] from where it has `radius` [m]."""
    return radius * turn - build_up * turn**2 / 4


@dataclass(frozen=True)
class DrumBuildUp(CableEffect):
    """Equal layers of cable on all drums; the radius of the drawing is that at home."""

    cause: ClassVar[str] = "drum_build_up"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drums",
        "compensate the layers of cable on the drums",
        "unwind one turn from a full and from a nearly empty drum and compare the lengths",
    )
    kind: ClassVar[str] = "drive"

    @property
    def parameters(self) -> ParameterSet:
        """c [m^2/m]: a millimetre of cable in layers that are 10 mm wide gives 0.03 mm^2/mm."""
        return self.shared("build_up", "m", 50e-6, 0.0, 5e-3)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-c phi^2 / 4 of the drum, through the tackle, as an angle."""
        own = cable(s, c)
        return let_out(own.angle / own.gear, 0.0, v[0]) / own.tackle / own.gain
