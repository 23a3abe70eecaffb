"""The drawing of a cable robot: cable ends and winches, their tolerances and the masses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ConfigError
from delta_calibration.sections import angle, mass, place, quantity, refused, tolerance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CableDimensions:
    """Cable ends and winches of a cable robot with m cables; the platform has k freedoms.

    A motor turn lets out 2 pi `drum_radius` / (`gear` `tackle`) of the free length: with a tackle
    of t the cable runs t times between anchor and platform.
    """

    anchors: Array = place(  # (m, 3)
        shape=(None, 3), about="a: where the cables leave the frame, in the base frame"
    )
    joints: Array = place(  # (m, 3)
        shape=(None, 3), about="b: where the cables end, in the platform's frame"
    )
    drum_radius: Array = quantity(
        "mm", above=0.0, shape=(None,), about="radius of each drum with the platform at home"
    )
    gear: Array = quantity(above=0.0, shape=(None,), about="motor turns per turn of the drum")
    tackle: Array = quantity(
        above=0.0, shape=(None,), about="number of cable lines between anchor and platform"
    )
    home_place: Array = place(
        shape=(3,), about="position of the platform at home, where the counters are zero"
    )
    home_turn: Array | None = angle(
        shape=(3,),
        default=None,
        about="rotation vector of the platform at home; left out for a point",
    )
    pretension: float = quantity(
        "n", least=0.0, default=0.0, about="force that the drives keep in every cable"
    )

    def __post_init__(self) -> None:
        """Refuse dimensions that do not describe a cable robot.

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
        """Pose at which the counters are zero, (3,) for a point or (6,) for a body [m, rad]."""
        turn = np.zeros(0) if self.home_turn is None else self.home_turn
        return np.concatenate([self.home_place, turn])

    @property
    def gain(self) -> Array:
        """k, (m,) [m/rad]: free cable length per motor angle."""
        return np.asarray(self.drum_radius / (self.gear * self.tackle))


@dataclass(frozen=True)
class CableTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    anchor: float = tolerance(about="point where a cable leaves the frame, each coordinate")
    joint: float = tolerance(about="point where a cable ends on the platform, each coordinate")
    gain: float = tolerance("percent", about="cable length per motor turn")
    zero: float | None = tolerance(
        default=None,
        about="counter reading at home, as cable length; left out: counters are zero at home",
    )


@dataclass(frozen=True)
class CableMasses:
    """Moving masses of a cable robot."""

    platform: float = mass(about="platform with everything permanently mounted on it")

    @property
    def on_platform(self) -> float:
        """Mass that moves with the platform: its own [kg]."""
        return self.platform
