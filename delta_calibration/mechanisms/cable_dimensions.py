"""The drawing of a cable robot and two sets of dimensions.

Paper 002 gives no dimensions: both sets here are ours. `EIGHT_CABLES` is a box of 4 x 3 x 2.5 m
with crossed cables to a tall body that moves with all six freedoms: of some shapes and crossings
tried, the one whose cables stay taut and whose condition is least; `FOUR_CABLES` carries a point
on three low cables and one from above.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ConfigError
from delta_calibration.sections import angle, mass, place, quantity, tolerance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CableDimensions:
    """Where the cables go and what winds them; m cables, k freedoms of the platform.

    A motor turn lets out 2 pi `drum_radius` / (`gear` `tackle`) of the free length: with a tackle
    of t the cable goes t times between anchor and platform.
    """

    # a, (m, 3) [m] where the cables leave, in the robot's frame
    anchors: Array = place(shape=(None, 3))
    joints: Array = place(shape=(None, 3))  # b, (m, 3) [m] where they end, in the platform's frame
    drum_radius: Array = quantity("mm", above=0.0, shape=(None,))  # (m,) [m] at home
    gear: Array = quantity(above=0.0, shape=(None,))  # (m,) motor turns a drum turn
    # (m,) lines between anchor and platform
    tackle: Array = quantity(above=0.0, shape=(None,))
    home_place: Array = place(shape=(3,))  # [m] where the counters are zero
    # rotation vector [rad] of the platform there; none of a point
    home_turn: Array | None = angle(shape=(3,), default=None)
    # [N] the drives keep every cable near
    pretension: float = quantity("n", least=0.0, default=0.0)

    def __post_init__(self) -> None:
        """Refuse what is no cable robot.

        Raises:
            ConfigError: names the entry, its value and what is allowed.
        """
        cables, freedoms = len(self.anchors), len(self.home)
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
    def home(self) -> Array:
        """Pose at which the counters are zero, (3,) of a point or (6,) of a body [m, rad]."""
        turn = np.zeros(0) if self.home_turn is None else self.home_turn
        return np.concatenate([self.home_place, turn])

    @property
    def gain(self) -> Array:
        """k, (m,) [m/rad]: free length a motor angle."""
        return np.asarray(self.drum_radius / (self.gear * self.tackle))


@dataclass(frozen=True)
class CableTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    anchor: float = tolerance()  # [m] each coordinate
    joint: float = tolerance()  # [m] each coordinate; of a body's platform
    gain: float = tolerance("percent")  # [1] of k, relative
    # [m] of free length, a counter at home; without it they are known to be zero there
    zero: float | None = tolerance(default=None)


@dataclass(frozen=True)
class CableMasses:
    """What moves."""

    platform: float = mass()  # [kg]

    @property
    def on_platform(self) -> float:
        """What moves with the platform: itself [kg]."""
        return self.platform


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
    home_place=np.array([0.0, 0.0, 1.25]),
    home_turn=np.zeros(3),
    pretension=400.0,
)

FOUR_CABLES = CableDimensions(
    anchors=np.array([[1.6, 0.0, 0.0], [-0.8, 1.4, 0.0], [-0.8, -1.4, 0.0], [0.0, 0.0, 2.5]]),
    joints=np.zeros((4, 3)),
    drum_radius=np.full(4, 0.05),
    gear=np.full(4, 10.0),
    tackle=np.ones(4),
    home_place=np.array([0.0, 0.0, 0.6]),
    pretension=60.0,
)

TOLERANCES = CableTolerances(anchor=10e-3, joint=2e-3, gain=5e-3)
ZEROS_FREE = replace(TOLERANCES, zero=10e-3)
