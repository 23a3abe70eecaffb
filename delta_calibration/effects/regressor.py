"""Horizontal axis of an effect's picture, and groups of samples that it shows by colour."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions

Array = NDArray[np.float64]
Groups = tuple[tuple[str, NDArray[np.bool_]], ...]  # name and samples (n,) of each

_DEGREES = 180 / np.pi
_MM = 1e3
_MOST_LEVELS = 3  # largest number of payload levels that get a colour each
_SAME = 1e-3  # [kg] difference up to which two payloads are one level


@dataclass(frozen=True)
class Regressor:
    """A quantity of each sample: `of(conditions, joint)` gives its values (n,).

    The joint's index matters only for a quantity that each joint has separately.
    """

    title: str  # with its unit
    of: Callable[[Conditions, int], Array]
    sliding: Regressor | None = None  # the same quantity for joints that slide

    def of_joints(self, unit: str) -> Regressor:
        """The regressor for joints whose unit is `rad` or `m`."""
        return self.sliding if unit == "m" and self.sliding is not None else self


def _length(v: Array) -> Array:
    return np.asarray(np.linalg.norm(v, axis=1))


ANGLE = Regressor(
    "angle of the joint [°]",
    lambda at, j: _DEGREES * at.joint[:, j],
    Regressor("position of the joint [mm]", lambda at, j: _MM * at.joint[:, j]),
)
CLOCK = Regressor("time [min]", lambda at, j: at.time / 60)
VELOCITY = Regressor(
    "speed of the joint [°/s]",
    lambda at, j: _DEGREES * at.velocity[:, j],
    Regressor("speed of the joint [mm/s]", lambda at, j: _MM * at.velocity[:, j]),
)
ACCELERATION = Regressor(
    "acceleration of the joint [rad/s²]",
    lambda at, j: at.acceleration[:, j],
    Regressor("acceleration of the joint [m/s²]", lambda at, j: at.acceleration[:, j]),
)
LOAD = Regressor("payload [kg]", lambda at, j: at.payload)
DISTANCE = Regressor("distance from the tracker [m]", lambda at, j: _length(at.reading))
READING_SPEED = Regressor(
    "speed of the reflector [m/s]", lambda at, j: _length(at.reading_velocity)
)


def temperature(part: str) -> Regressor:
    """Temperature of a part."""
    words = part.replace("_", " ")
    return Regressor(f"temperature of the {words} [°C]", lambda at, j: at.of_part(part))


def all_together(at: Conditions) -> Groups:
    """All samples in one group."""
    return (("measured", np.ones(len(at), dtype=bool)),)


def by_direction(at: Conditions, joint: int) -> Groups:
    """Samples by a joint's last direction of motion."""
    side = at.direction[:, joint]
    return ("joint last went up", side > 0), ("joint last went down", side < 0)


def by_payload(at: Conditions) -> Groups:
    """Samples by payload, if there are two or three levels; else all in one group."""
    levels = np.unique(np.round(at.payload[np.isfinite(at.payload)], 3))
    if not 1 < len(levels) <= _MOST_LEVELS:
        return all_together(at)
    return tuple((f"{kg:g} kg", np.abs(at.payload - kg) < _SAME) for kg in levels)
