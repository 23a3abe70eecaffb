"""The drawing of a cable robot: where cables go, what winds them, and how far both may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ConfigError
from delta_calibration.sections import angle, mass, place, quantity, refused, tolerance

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
                f"anchors_mm: {cables} cables are not allowed; {freedoms} or more, one a freedom"
            )
        winches = "drum_radius", "gear", "tackle"
        places = {name: (cables, 3) for name in ("anchors", "joints")}
        for name, shape in {**places, **{name: (cables,) for name in winches}}.items():
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                size = " times ".join(map(str, shape))
                raise refused(self, name, f"{size} finite numbers")
        for name in winches:
            if not (getattr(self, name) > 0).all():
                raise refused(self, name, "each above 0")
        if freedoms == 3 and self.joints.any():
            raise refused(self, "joints", "0, as a point (no home_turn_deg) has no extent")
        if not 0 <= self.pretension < np.inf:
            raise refused(self, "pretension", "0 or more")

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
