"""Signals: all numbers of a sample that an effect's law may take.

Some are recorded (joint angles, rates, direction of the last motion, payload, temperatures, ...),
others are computed with the machine's model (pose, dimensions, torques of weight and inertia,
pulls of cables, force and moment on the base and on the platform). A law names the signals that it
takes; each has a fixed place in one row of numbers, the same for all effects on a mechanism.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.lazy import cached_property
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.chain_constants import (
    OF_CARRIED,
    OF_DIMENSIONS,
    OF_INERTIA,
    OF_PULLS,
    OF_REACTION,
    OF_TIGHTNESS,
    OF_WEIGHT,
)
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

JOINT, RATE, ACCELERATION = "joint", "rate", "acceleration"
DIRECTION, TRAVEL = "direction", "travel"
GRAVITY, INERTIA, PULL, PULL_HOME = "gravity", "inertia", "pull", "pull_home"
POSE, GEOMETRY, LOAD, REACTION = "pose", "geometry", "load", "reaction"
CARRIED, TIGHTNESS = "carried", "tightness"  # payload's force, moment; pulls per pretension
TIME, PAYLOAD, CENTRE, TEMPERATURE = "time", "payload", "centre", "temperature"
READING, READING_RATE, NOTHING = "reading", "reading_rate", "nothing"
READING_ACCELERATION = "reading_acceleration"

_ASKED = {
    GRAVITY: OF_WEIGHT,
    LOAD: OF_WEIGHT | OF_INERTIA | OF_DIMENSIONS,
    INERTIA: OF_INERTIA,
    REACTION: OF_REACTION,
    CARRIED: OF_CARRIED,
    PULL: OF_PULLS,
    PULL_HOME: OF_PULLS,
    TIGHTNESS: OF_TIGHTNESS,
}
_STANDING = (*_ASKED, POSE, GEOMETRY)  # signals that require the machine's pose
PLACE, MOTION, SIDE, COURSE, MASS = "place", "motion", "side", "course", "mass"
KINDS = frozenset((PLACE, MOTION, SIDE, COURSE, MASS))  # side of approach, course of time
_KINDS = {
    **dict.fromkeys((JOINT, POSE, GEOMETRY, READING, TIGHTNESS), frozenset({PLACE})),
    **dict.fromkeys((GRAVITY, CARRIED, PULL, PULL_HOME), frozenset({PLACE, MASS})),
    **dict.fromkeys((LOAD, REACTION), frozenset({PLACE, MASS, MOTION})),
    **dict.fromkeys((RATE, ACCELERATION, READING_RATE, READING_ACCELERATION), frozenset({MOTION})),
    **dict.fromkeys((DIRECTION, TRAVEL), frozenset({SIDE})),
    **dict.fromkeys((TIME, TEMPERATURE), frozenset({COURSE})),
    **dict.fromkeys((PAYLOAD, CENTRE), frozenset({MASS})),
    INERTIA: frozenset({MOTION, MASS}),
}
OF_PULLING = (PULL, PULL_HOME, TIGHTNESS)  # signals of limbs that can only pull
OF_JOINTS = (JOINT, RATE, ACCELERATION, DIRECTION, TRAVEL, GRAVITY, INERTIA, *OF_PULLING)


def kinds_of(names: Iterable[str]) -> frozenset[str]:
    """Kinds of quantity, of `KINDS`, that signals vary with; loads vary with several."""
    return frozenset().union(*(_KINDS.get(name, ()) for name in names))


@dataclass(frozen=True)
class Places:
    """Layout of the signals in a sample's row.

    Attributes:
        sizes: name and number of numbers of each signal, in order.
        parts: parts whose temperatures are recorded.
    """

    sizes: tuple[tuple[str, int], ...]
    parts: tuple[str, ...]

    @classmethod
    def of(cls, mechanism: Mechanism, parts: tuple[str, ...]) -> Places:
        """Layout for a mechanism and the parts whose temperatures are recorded."""
        return _places(mechanism.joints, mechanism.pose_size, len(mechanism.parameters), parts)

    @property
    def of_joints(self) -> tuple[str, ...]:
        """Signals with one number per joint."""
        return OF_JOINTS

    def count(self, name: str) -> int:
        """Number of numbers of a signal."""
        return dict(self.sizes)[name]

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Slice of each signal in a row."""
        ends = accumulate((size for _, size in self.sizes), initial=0)
        spans = (slice(*span) for span in pairwise(ends))
        return dict(zip((name for name, _ in self.sizes), spans, strict=True))

    def begin(self, name: str) -> int:
        """Index of a signal's first number."""
        return int(self.slices[name].start)

    @cached_property
    def size(self) -> int:
        """Number of numbers in a row."""
        return sum(size for _, size in self.sizes)

    def temperature(self, part: str) -> int:
        """Index of a part's temperature; that of `NOTHING` if it is not recorded."""
        if part not in self.parts:
            return self.begin(NOTHING)
        return self.begin(TEMPERATURE) + self.parts.index(part)


@lru_cache(maxsize=64)
def _places(m: int, k: int, p: int, parts: tuple[str, ...]) -> Places:
    of_sample = ((TIME, 1), (PAYLOAD, 1), (CENTRE, 3), (TEMPERATURE, len(parts)))
    of_tracker = ((READING, 3), (READING_RATE, 3), (READING_ACCELERATION, 3), (NOTHING, 1))
    of_machine = ((POSE, k), (GEOMETRY, p), (LOAD, p), (REACTION, 6), (CARRIED, 6))
    return Places(
        (*((name, m) for name in OF_JOINTS), *of_machine, *of_sample, *of_tracker), parts
    )


def asked_of(names: Any) -> int:
    """Loads that these signals need, as a sum of flags."""
    flags = 0
    for name in names:
        flags |= _ASKED.get(name, 0)
    return flags


def all_asked(mechanism: Mechanism) -> int:
    """All loads that a mechanism has, as a sum of flags."""
    pulls = OF_PULLS | OF_TIGHTNESS if mechanism.pulls else 0
    return OF_WEIGHT | OF_INERTIA | OF_DIMENSIONS | OF_REACTION | OF_CARRIED | pulls


def standing_asked(names: Any) -> bool:
    """Whether any of these signals requires the machine's pose."""
    return any(name in _STANDING for name in names)


@dataclass(frozen=True)
class Signals:
    """Signals of n samples: rows of numbers, and their layout."""

    places: Places
    rows: Array  # (n, S)

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, rows: NDArray[Any] | slice) -> Signals:
        """Some of the samples."""
        return replace(self, rows=self.rows[rows])

    def of(self, name: str) -> Array:
        """One signal of all samples, (n, size)."""
        return self.rows[:, self.places.slices[name]]

    def with_(self, **values: Array) -> Signals:
        """Copy with other values of some signals."""
        rows = self.rows.copy()
        changed = replace(self, rows=rows)
        for name, value in values.items():
            changed.of(name)[:] = value
        return changed


def recorded(mechanism: Mechanism, at: Conditions) -> Signals:
    """Recorded signals of samples; those computed with the machine's model are zero."""
    places = Places.of(mechanism, at.temperature_parts)
    rows, where = np.zeros((len(at), places.size)), places.slices
    rows[:, where[JOINT]] = at.joint
    rows[:, where[RATE]] = at.velocity
    rows[:, where[ACCELERATION]] = at.acceleration
    rows[:, where[DIRECTION]] = at.direction
    rows[:, where[TRAVEL]] = at.travel
    rows[:, where[TIME].start] = at.time
    rows[:, where[PAYLOAD].start] = at.payload
    rows[:, where[CENTRE]] = at.payload_centre
    rows[:, where[TEMPERATURE]] = at.temperature
    rows[:, where[READING]] = at.reading
    rows[:, where[READING_RATE]] = at.reading_velocity
    rows[:, where[READING_ACCELERATION]] = at.reading_acceleration
    return Signals(places, rows)


def standing(
    signals: Signals,
    robot: Robot,
    mechanism: Mechanism,
    x: Array,
    g: Array,
    asked: int,
    joint: Array | None = None,
) -> Signals:
    """Signals of a machine at poses x (n, k) with dimensions g, including its loads.

    Args:
        signals: recorded signals.
        robot: robot with its masses.
        mechanism: mechanism of the machine.
        x: poses, (n, k).
        g: dimensions, (p,) or (n, p).
        asked: wanted loads, see `asked_of`.
        joint: actual joint coordinates, (n, m); by default those of the signals.
    """
    found = signals.with_(**{POSE: x, GEOMETRY: g})
    if asked:
        q = found.of(JOINT) if joint is None else joint
        borne = mechanism.loads(
            robot.masses,
            asked,
            q,
            x,
            g,
            found.of(RATE),
            found.of(ACCELERATION),
            found.of(PAYLOAD)[:, 0],
            found.of(CENTRE),
        )
        loads = {GRAVITY: borne.weight, INERTIA: borne.inertia, LOAD: borne.dimension}
        loads |= {REACTION: borne.reaction, CARRIED: borne.payload}
        if mechanism.pulls:
            loads |= {PULL: borne.pull, PULL_HOME: borne.pull_home, TIGHTNESS: borne.tightness}
        for name, values in loads.items():
            found.of(name)[:] = values
    return found


def nominal(robot: Robot, mechanism: Mechanism, at: Conditions, asked: int) -> Signals:
    """Signals of the nominal machine under these conditions, with the wanted loads."""
    g, signals = mechanism.parameters.nominal, recorded(mechanism, at)
    x = mechanism.forward(at.joint, g)
    return standing(signals, robot, mechanism, x, g, asked)
