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
from delta_calibration.effects.cables import CableEffect
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions

_LEAST = 1e-6  # [m] radius whose excess is its derivative


def excess(level: Array, above: Array, radius: float) -> Array:
    """Length over the pulley less the straight distance [m].

    Args:
        level: h, horizontal distance of the platform joint from the anchor [m], over 2 r.
        above: z, its height over the anchor [m].
        radius: r [m].
    """
    tangent = np.sqrt((level - radius) ** 2 + above**2 - radius**2)
    wrap = np.arctan2(level - radius, above) + np.arctan2(radius, tangent)
    return np.asarray(radius * wrap + tangent - np.hypot(level, above))


@dataclass(frozen=True)
class PulleyRadius(CableEffect):
    """Pulleys of one radius at all anchors; not proportional to it, so `radius` is the shape."""

    cause: ClassVar[str] = "pulley_radius"
    kind: ClassVar[str] = "structure"
    limits: ClassVar[Limits] = {"radius": (0.0, 0.5)}

    radius: float = 0.0  # [m] at which the excess is taken, in proportion about it

    @property
    def parameters(self) -> ParameterSet:
        """r [m]."""
        return self.shared("radius", "m", 30e-3, 0.0, 0.5)

    def columns(self, at: Conditions) -> Array:
        """(n, m, 1) [rad/m]."""
        return -self.as_angle(self._excess(at) - self._excess(self.at_home()))[..., None]

    def refined(self, values: Array) -> PulleyRadius:
        """Exact at the radius that was found."""
        return replace(self, radius=float(max(values[0], 0.0)))

    def _excess(self, at: Conditions) -> Array:
        """For a metre of radius, (n, m) [m/m]."""
        radius = max(self.radius, _LEAST)
        x, nominal = self.poses(at), self.mechanism.parameters.nominal
        down = -self.lengths(at)[..., None] * self.cables.directions(x, nominal)
        level = np.hypot(down[..., 0], down[..., 1])
        return excess(level, down[..., 2], radius) / radius
