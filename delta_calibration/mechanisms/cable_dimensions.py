"""The drawing of a cable robot and two sets of dimensions.

Paper 002 gives no dimensions: both sets here are ours. `EIGHT_CABLES` is a box of 4 x 3 x 2.5 m
with crossed cables to a tall body that moves with all six freedoms: of some shapes and crossings
tried, the one whose cables stay taut and whose condition is least; `FOUR_CABLES` carries a point
on three low cables and one from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ConfigError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CableDimensions:
    """Where the cables go and what winds them; m cables, k freedoms of the platform.

    A motor turn lets out 2 pi `drum_radius` / (`gear` `tackle`) of the free length: with a tackle
    of t the cable goes t times between anchor and platform.
    """

    anchors: Array  # a, (m, 3) [m] where the cables leave, in the robot's frame
    joints: Array  # b, (m, 3) [m] where they end, in the platform's frame
    drum_radius: Array  # (m,) [m] at home
    gear: Array  # (m,) motor turns a drum turn
    tackle: Array  # (m,) lines between anchor and platform
    home: Array  # (k,) pose at which the counters are zero; 3: a point, 6: a body
    pretension: float = 0.0  # [N] the drives keep every cable near

    def __post_init__(self) -> None:
        """Refuse what is no cable robot.

        Raises:
            ConfigError: names the entry, its value and what is allowed.
        """
        cables, freedoms = len(self.anchors), len(self.home)
        if freedoms not in (3, 6):
            raise ConfigError(f"home: {freedoms} coordinates are not allowed; 3 or 6")
        if cables < freedoms:
            raise ConfigError(
                f"anchors: {cables} cables are not allowed; {freedoms} or more, one a freedom"
            )
        winches = "drum_radius", "gear", "tackle"
        places = {name: (cables, 3) for name in ("anchors", "joints")}
        for name, shape in {**places, **{name: (cables,) for name in winches}}.items():
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise ConfigError(
                    f"{name}: {value.tolist()} is not allowed; {shape} finite numbers"
                )
        for name in winches:
            if not (getattr(self, name) > 0).all():
                value = getattr(self, name).tolist()
                raise ConfigError(f"{name}: {value} is not allowed; each above 0")
        if freedoms == 3 and self.joints.any():
            raise ConfigError(
                f"joints: {self.joints.tolist()} is not allowed; 0, as a point has no extent"
            )
        if not 0 <= self.pretension < np.inf:
            raise ConfigError(f"pretension: {self.pretension} is not allowed; 0 or more")

    @property
    def gain(self) -> Array:
        """k, (m,) [m/rad]: free length a motor angle."""
        return np.asarray(self.drum_radius / (self.gear * self.tackle))


@dataclass(frozen=True)
class CableTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    anchor: float  # [m] each coordinate
    joint: float  # [m] each coordinate
    gain: float  # [1] of k, relative
    zero: float  # [m] of free length, counter zero at home; where zeros are free


def _box(size: tuple[float, float, float], rows: tuple[int, ...]) -> Array:
    """Corners of a box about the origin by number; 1 in it is +x, 2 +y, 4 +z.  -> (rows, 3)."""
    bits = np.array([[(row >> axis) & 1 for axis in range(3)] for row in rows])
    return np.asarray((bits - 0.5) * np.array(size))


_CORNERS = tuple(range(8))
# a joint on the far side in y and the other height: crossed cables hold the platform's turns
_CROSSED = tuple(corner ^ 0b110 for corner in _CORNERS)

EIGHT_CABLES = CableDimensions(
    anchors=_box((4.0, 3.0, 2.5), _CORNERS) + np.array([0.0, 0.0, 1.25]),
    joints=_box((0.4, 0.4, 0.8), _CROSSED),
    drum_radius=np.full(8, 0.05),
    gear=np.full(8, 10.0),
    tackle=np.ones(8),
    home=np.array([0.0, 0.0, 1.25, 0.0, 0.0, 0.0]),
    pretension=400.0,
)

FOUR_CABLES = CableDimensions(
    anchors=np.array([[1.6, 0.0, 0.0], [-0.8, 1.4, 0.0], [-0.8, -1.4, 0.0], [0.0, 0.0, 2.5]]),
    joints=np.zeros((4, 3)),
    drum_radius=np.full(4, 0.05),
    gear=np.full(4, 10.0),
    tackle=np.ones(4),
    home=np.array([0.0, 0.0, 0.6]),
    pretension=60.0,
)

TOLERANCES = CableTolerances(anchor=10e-3, joint=2e-3, gain=5e-3, zero=10e-3)
