"""Cables that sag under their own weight: the arc let out is longer than its chord.

    arc - chord = w^2 h^2 c / (24 T^2)        c: chord, h: its horizontal part, T: pull along it

the first term of the catenary, good to a thousandth up to w h = T / 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array
from delta_calibration.effects.cables import CableEffect
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


def slack_of_sag(chord: Array, level: Array, tension: Array) -> Array:
    """Arc less chord [m] for a weight of 1 N/m; chord and its horizontal part `level` [m]."""
    return np.asarray(level**2 * chord / (24 * tension**2))


@dataclass(frozen=True)
class CableSag(CableEffect):
    """Sag of all cables, of one kind; cables that are slack have no answer here."""

    cause: ClassVar[str] = "cable_sag"
    kind: ClassVar[str] = "structure"
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def parameters(self) -> ParameterSet:
        """w^2 [N^2/m^2], in which the effect is linear: steel of 4 mm weighs 0.6 N/m."""
        return self.shared("weight_squared", "N^2/m^2", 1.0, 0.0, 1e4)

    def columns(self, at: Conditions) -> Array:
        """(n, m, 1) [rad m^2/N^2].

        Raises:
            ReachError: a cable is slack at the mechanism's pretension.
        """
        return -self.as_angle(self._slack(at) - self._slack(self.at_home()))[..., None]

    def missing(self, at: Conditions) -> str:
        """The payload, or tension in every cable."""
        said = super().missing(at)
        return said or ("a cable is slack" if (self.tensions(at) <= 0).any() else "")

    def _slack(self, at: Conditions) -> Array:
        tension, chord = self.tensions(at), self.lengths(at)
        self.cables.require_taut(tension)
        u = self.cables.directions(self.poses(at), self.mechanism.parameters.nominal)
        level = chord * np.hypot(u[..., 0], u[..., 1])
        return slack_of_sag(chord, level, tension)
