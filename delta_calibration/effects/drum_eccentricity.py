"""A drum whose groove runs out of true, or whose own counter is mounted off its centre.

    dl = a sin phi + b (cos phi - 1)        sqrt(a^2 + b^2): eccentricity, half of the run-out

phi is the angle of the drum, once round in as many motor turns as its gear has. What it lets out
goes through the tackle to the platform. A drum without a gear turns with its encoder, whose own
eccentricity looks the same; it is not among these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.cables import CableEffect, cable
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import Places
from delta_calibration.mechanisms import CableRobot
from delta_calibration.model.symbols import Symbol, cos, sin
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class DrumEccentricity(CableEffect):
    """Error of one cycle per turn of each drum behind a gear."""

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
        return isinstance(self.mechanism, CableRobot) and bool(self._geared)

    @property
    def parameters(self) -> ParameterSet:
        """a and b of each drum [m]: of 0.1 mm where drum and shaft are separate parts."""
        every = [
            self.each_joint(name, "m", 0.1e-3, -20e-3, 20e-3).items for name in ("sine", "cosine")
        ]
        return ParameterSet(tuple(each[i] for each in every for i in self._geared))

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per cable, with both its amplitudes."""
        every, count = tuple(super().terms(places)), len(self._geared)
        for k, i in enumerate(self._geared):
            yield replace(every[i], values=(k, count + k))

    @property
    def _geared(self) -> tuple[int, ...]:
        """Cables whose drums are behind gears."""
        return tuple(np.flatnonzero(self.cables.dimensions.gear != 1).tolist())

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """The cable that the drum lets out too much, through the tackle, as an angle."""
        own = cable(s, c)
        turn = own.angle / own.gear
        return (v[0] * sin(turn) + v[1] * (cos(turn) - 1)) / own.tackle / own.gain
