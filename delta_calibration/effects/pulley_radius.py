"""Cables that leave the frame over a swivelling pulley, not through a point.

The cable runs along the pulley's swivel axis, which is vertical and passes through the anchor, and
leaves tangentially towards the platform joint, h away from the anchor and z farther along the way
by which the cable comes:

    d = (h - r, z)    t = sqrt(|d|^2 - r^2)    gamma = atan2(h - r, z) + atan2(r, t)
    length = r gamma + t                       dl = |(h, z)| - length

z is the height of the joint above the anchor if the cable comes from below, and its depth below
the anchor if it comes from above. Where the winches stand decides; it may differ between anchors
above and below the platform.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array, Effect, Limits
from delta_calibration.effects.cables import CableEffect, cable, length, level
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import Places
from delta_calibration.geometry import rotations
from delta_calibration.model.symbols import Symbol, atan2, sqrt
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet

BELOW, ABOVE = 1.0, -1.0  # side from which the cable comes, as a sign of z
# words for whether cables come from above at the upper pulleys, and at the lower ones
_FROM_ABOVE = {
    (True, True): "all",
    (True, False): "the upper",
    (False, True): "the lower",
    (False, False): "",
}


def excess(away: Symbol, radius: Symbol, side: Symbol = BELOW) -> Symbol:
    """Length over the pulley minus the straight distance [m].

    Args:
        away: vector from the anchor to the platform joint [m]; its horizontal part exceeds 2 r.
        radius: r [m].
        side: from which the cable comes to the pulley: `BELOW` or `ABOVE`.
    """
    across, above = level(away) - radius, side * away[2]
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
    limits: ClassVar[Limits] = {
        "radius": (0.0, 0.5),
        "upper": (ABOVE, BELOW),
        "lower": (ABOVE, BELOW),
    }

    radius: float = 0.0  # [m] about which the effect is linearized
    upper: float = BELOW  # side from which cables come to the pulleys above the platform at home
    lower: float = BELOW  # and to those below it

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
        own, side = cable(s, c[:-1]), c[-1]
        return -(excess(own.at, v[0], side) - excess(own.home, v[0], side)) / own.gain

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per cable; the last constant is the side from which it comes."""
        sides = np.where(self._is_upper, self.upper, self.lower).tolist()
        for term, side in zip(super().terms(places), sides, strict=True):
            yield replace(term, constants=(*term.constants, side))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Every combination of sides from which cables come to upper and to lower pulleys."""
        del at
        both, one = (BELOW, ABOVE), (BELOW,)
        above, below = self._is_upper.any(), not self._is_upper.all()
        for upper, lower in product(both if above else one, both if below else one):
            yield replace(self, upper=upper, lower=lower)

    @property
    def chosen(self) -> dict[str, str]:
        """Pulleys that cables come to from above, if any."""
        which = _FROM_ABOVE[self.upper == ABOVE, self.lower == ABOVE]
        return {"cables_from_above": f"at {which} pulleys"} if which else {}

    def wrong(self) -> str:
        """As for every effect; and a side that is neither."""
        for name in ("upper", "lower"):
            if (value := getattr(self, name)) not in (ABOVE, BELOW):
                return f"{name}: {value} is not allowed; {ABOVE:g} or {BELOW:g}"
        return super().wrong()

    def refined(self, values: Array) -> PulleyRadius:
        """The effect linearized at the identified radius."""
        return replace(self, radius=float(max(values[0], 0.0)))

    @property
    def _is_upper(self) -> NDArray[np.bool_]:
        """Whether an anchor is at least as high as its joint on the platform at home, (m,)."""
        d = self.cables.dimensions
        joints = d.home_place
        if d.home_turn is not None:
            joints = joints + d.joints @ rotations.exp(d.home_turn).T
        return np.asarray(d.anchors[:, 2] >= (joints + 0 * d.anchors)[:, 2])
