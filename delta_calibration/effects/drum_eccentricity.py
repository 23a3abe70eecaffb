"""A drum whose groove runs out of true, or whose own counter is mounted off its centre.

    dl = a sin phi + b (cos phi - 1)        sqrt(a^2 + b^2): eccentricity of the groove

phi is the angle of the drum, once round in as many motor turns as its gear has. What it lets out
goes through the tackle to the platform.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

from delta_calibration.effects.cables import CableEffect, cable
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import Places
from delta_calibration.mechanisms import CableRobot
from delta_calibration.model.symbols import Symbol, cos, sin
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class DrumEccentricity(CableEffect):
    """Error of one cycle per turn of each drum, behind a gear: else it is the encoder's."""

    cause: ClassVar[str] = "drum_eccentricity"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drums",
        "compensate the eccentricity of the drum, or true its groove",
        "turn the drum once and read the run-out of its groove off a dial gauge",
    )
    kind: ClassVar[str] = "drive"

    @property
    def suits(self) -> bool:
        """Whether there are drums behind gears."""
        robot = self.mechanism
        return isinstance(robot, CableRobot) and bool((robot.dimensions.gear != 1).any())

    @property
    def parameters(self) -> ParameterSet:
        """a and b of each drum [m]: a groove turned in one clamping runs true to 0.05 mm."""
        sine, cosine = (
            self.each_joint(name, "m", 0.1e-3, -20e-3, 20e-3) for name in ("sine", "cosine")
        )
        return ParameterSet((*sine, *cosine))

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per cable, with both its amplitudes."""
        for i, term in enumerate(super().terms(places)):
            yield replace(term, values=(i, self.mechanism.joints + i))

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """The cable that the drum lets out too much, through the tackle, as an angle."""
        own = cable(s, c)
        turn = own.angle / own.gear
        return (v[0] * sin(turn) + v[1] * (cos(turn) - 1)) / own.tackle / own.gain
