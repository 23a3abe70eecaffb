"""Cables that leave the frame over a swivelling pulley, not through a point.

The cable runs up along the pulley's swivel axis, which is vertical and passes through the anchor,
and leaves tangentially towards the platform joint, h away from the anchor and z above it:

    d = (h - r, z)    t = sqrt(|d|^2 - r^2)    gamma = atan2(h - r, z) + atan2(r, t)
    length = r gamma + t                       dl = |(h, z)| - length
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Limits
from delta_calibration.effects.cables import CableEffect, cable, length, level
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.model.symbols import Symbol, atan2, sqrt
from delta_calibration.parameters import ParameterSet


def excess(away: Symbol, radius: Symbol) -> Symbol:
    """Length over the pulley minus the straight distance [m].

    Args:
        away: vector from the anchor to the platform joint [m]; its horizontal part exceeds 2 r.
        radius: r [m].
    """
    across, above = level(away) - radius, away[2]
    tangent = sqrt(across**2 + above**2 - radius**2)
    wrap = atan2(across, above) + atan2(radius, tangent)
    return radius * wrap + tangent - length(away)


@dataclass(frozen=True)
class PulleyRadius(CableEffect):
    """Pulleys of the same radius at all anchors.

    The effect is not proportional to the radius: columns are derivatives at `radius`, which
    follows the identified value.
    """

    cause: ClassVar[str] = "pulley_radius"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "pulleys",
        "enter the true radius of the pulleys",
        "measure the diameter of the groove of a pulley",
    )
    kind: ClassVar[str] = "structure"
    limits: ClassVar[Limits] = {"radius": (0.0, 0.5)}

    radius: float = 0.0  # [m] about which the effect is linearized

    @property
    def parameters(self) -> ParameterSet:
        """r [m]."""
        return self.shared("radius", "m", 30e-3, 0.0, 0.5)

    @property
    def about(self) -> Array:
        """Radius about which the effect is linearized [m], (1,)."""
        return np.array([self.radius])

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Extra length over the pulley relative to home, as a negative motor angle."""
        own = cable(s, c)
        return -(excess(own.at, v[0]) - excess(own.home, v[0])) / own.gain

    def refined(self, values: Array) -> PulleyRadius:
        """The effect linearized at the identified radius."""
        return replace(self, radius=float(max(values[0], 0.0)))
