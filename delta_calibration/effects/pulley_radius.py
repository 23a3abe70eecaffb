"""Cables that leave over a swivelling pulley, not through a point.

The cable comes up the pulley's swivel axis, which is vertical and goes through the anchor, and
leaves tangentially towards the platform joint, h away and z above the anchor:

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
    """Length over the pulley less the straight distance [m].

    Args:
        away: from the anchor to the platform joint [m]; level with it over 2 r.
        radius: r [m].
    """
    across, above = level(away) - radius, away[2]
    tangent = sqrt(across**2 + above**2 - radius**2)
    wrap = atan2(across, above) + atan2(radius, tangent)
    return radius * wrap + tangent - length(away)


@dataclass(frozen=True)
class PulleyRadius(CableEffect):
    """Pulleys of one radius at all anchors.

    The effect is not proportional to the radius: columns are slopes at `radius`, which follows the
    value that is found.
    """

    cause: ClassVar[str] = "pulley_radius"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "pulleys",
        "enter the pulleys' radius",
        "measure the diameter of a pulley's groove",
    )
    kind: ClassVar[str] = "structure"
    limits: ClassVar[Limits] = {"radius": (0.0, 0.5)}

    radius: float = 0.0  # [m] about which the effect is taken as linear

    @property
    def parameters(self) -> ParameterSet:
        """r [m]."""
        return self.shared("radius", "m", 30e-3, 0.0, 0.5)

    @property
    def about(self) -> Array:
        """The radius about which it is linear."""
        return np.array([self.radius])

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Length over the pulley beyond the straight one, as an angle that lets out less."""
        own = cable(s, c)
        return -(excess(own.at, v[0]) - excess(own.home, v[0])) / own.gain

    def refined(self, values: Array) -> PulleyRadius:
        """Exact at the radius that was found."""
        return replace(self, radius=float(max(values[0], 0.0)))
