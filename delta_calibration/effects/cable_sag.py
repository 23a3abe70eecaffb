"""Cables that sag under their own weight: the arc let out is longer than its chord.

    arc - chord = w^2 h^2 c / (24 T^2)        c: chord, h: its horizontal part, T: pull along it

the first term of the catenary, good to a thousandth up to w h = T / 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array
from delta_calibration.effects.cables import CableEffect, cable, length, level
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import Signals
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


def slack_of_sag(chord: Symbol, level: Symbol, pull: Symbol) -> Symbol:
    """Arc minus chord [m] for a weight of 1 N/m; chord and its horizontal part `level` [m]."""
    return level**2 * chord / (24 * pull**2)


@dataclass(frozen=True)
class CableSag(CableEffect):
    """Sag of all cables, which are of one kind; not defined for slack cables."""

    cause: ClassVar[str] = "cable_sag"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "cables",
        "compensate the sag of the cables, or tighten them",
        "repeat ten poses with the cables tighter: the error decreases with the square of the "
        "tension",
    )
    kind: ClassVar[str] = "structure"
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    asks_pose: ClassVar[bool] = True

    @property
    def parameters(self) -> ParameterSet:
        """w^2 [N^2/m^2], in which the effect is linear: steel of 4 mm weighs 0.6 N/m."""
        return self.shared("weight_squared", "N^2/m^2", 1.0, 0.0, 1e4)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Arc minus chord relative to home, as a negative motor angle."""
        own = cable(s, c)
        more = slack_of_sag(length(own.at), level(own.at), own.pull)
        at_home = slack_of_sag(length(own.home), level(own.home), own.pull_home)
        return -v[0] * (more - at_home) / own.gain

    def columns_of(
        self, signals: Signals, values: Array | None = None, by_stage: Array | None = None
    ) -> Array:
        """See `Effect.columns_of`; of the stage itself (n, m, 1) [rad m^2/N^2].

        Raises:
            ReachError: a cable is slack at the mechanism's pretension.
        """
        self.cables.require_taut(self.pulls(signals))
        return super().columns_of(signals, values, by_stage)

    def missing(self, at: Conditions) -> str:
        """Payload that is not known, or a slack cable."""
        said = super().missing(at)
        return said or ("a cable is slack" if (self.pulls(self.nominal(at)) <= 0).any() else "")
