"""Signals: all numbers of a sample that an effect's law may take.

What was recorded (joint angles, rates, direction of the last motion, payload, temperatures, ...)
and what the machine makes of it (pose, dimensions, torques of weight and inertia, pulls of
cables, force and moment on the base and on the platform). A law names the ones it takes; each has
a place in one row of numbers, the same for all effects on a mechanism.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
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
CARRIED, TIGHTNESS = "carried", "tightness"  # by the payload; of pulls, by the pretension
TIME, PAYLOAD, CENTRE, TEMPERATURE = "time", "payload", "centre", "temperature"
READING, READING_RATE, NOTHING = "reading", "reading_rate", "nothing"

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
_STANDING = (*_ASKED, POSE, GEOMETRY)  # what only a machine that stands somewhere has
OF_PULLING = (PULL, PULL_HOME, TIGHTNESS)  # what only limbs have that can do nothing else
OF_JOINTS = (JOINT, RATE, ACCELERATION, DIRECTION, TRAVEL, GRAVITY, INERTIA, *OF_PULLING)


@dataclass(frozen=True)
class Places:
    """Where each signal begins in a sample's row.

    Attributes:
        sizes: name and how many numbers, in order.
        parts: of which temperatures are known.
    """

    sizes: tuple[tuple[str, int], ...]
    parts: tuple[str, ...]

    @classmethod
    def of(cls, mechanism: Mechanism, parts: tuple[str, ...]) -> Places:
        """Of a mechanism, and the parts whose temperature is recorded."""
        return _places(mechanism.joints, mechanism.pose_size, len(mechanism.parameters), parts)

    @property
    def of_joints(self) -> tuple[str, ...]:
        """Signals that each joint has of its own."""
        return OF_JOINTS

    def count(self, name: str) -> int:
        """How many numbers a signal has."""
        return dict(self.sizes)[name]

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Where each signal stands in a row."""
        ends = accumulate((size for _, size in self.sizes), initial=0)
        spans = (slice(*span) for span in pairwise(ends))
        return dict(zip((name for name, _ in self.sizes), spans, strict=True))

    def begin(self, name: str) -> int:
        """Place of a signal's first number."""
        return int(self.slices[name].start)

    @cached_property
    def size(self) -> int:
        """Numbers in a row."""
        return sum(size for _, size in self.sizes)

    def temperature(self, part: str) -> int:
        """Place of a part's temperature; where it is not recorded, of nothing."""
        if part not in self.parts:
            return self.begin(NOTHING)
        return self.begin(TEMPERATURE) + self.parts.index(part)


@lru_cache(maxsize=64)
def _places(m: int, k: int, p: int, parts: tuple[str, ...]) -> Places:
    of_sample = ((TIME, 1), (PAYLOAD, 1), (CENTRE, 3), (TEMPERATURE, len(parts)))
    of_tracker = ((READING, 3), (READING_RATE, 3), (NOTHING, 1))
    of_machine = ((POSE, k), (GEOMETRY, p), (LOAD, p), (REACTION, 6), (CARRIED, 6))
    return Places(
        (*((name, m) for name in OF_JOINTS), *of_machine, *of_sample, *of_tracker), parts
    )


def asked_of(names: Any) -> int:
    """Which loads (sums of flags) these signals need."""
    flags = 0
    for name in names:
        flags |= _ASKED.get(name, 0)
    return flags


def all_asked(mechanism: Mechanism) -> int:
    """Flags of every load that a mechanism has."""
    pulls = OF_PULLS | OF_TIGHTNESS if mechanism.pulls else 0
    return OF_WEIGHT | OF_INERTIA | OF_DIMENSIONS | OF_REACTION | OF_CARRIED | pulls


def standing_asked(names: Any) -> bool:
    """Whether any of these signals needs a machine that stands somewhere."""
    return any(name in _STANDING for name in names)


@dataclass(frozen=True)
class Signals:
    """Signals of n samples: rows of numbers, and where each stands in them."""

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
        """The same with other values of some signals."""
        rows = self.rows.copy()
        changed = replace(self, rows=rows)
        for name, value in values.items():
            changed.of(name)[:] = value
        return changed


def recorded(mechanism: Mechanism, at: Conditions) -> Signals:
    """What was recorded of samples; what only a machine has is zero."""
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
    """The signals of a machine that stands at poses x (n, k) with dimensions g, its loads with it.

    Args:
        signals: what was recorded.
        robot: masses.
        mechanism: the machine.
        x: its poses, (n, k).
        g: its dimensions, (p,) or (n, p).
        asked: loads, see `asked_of`.
        joint: where its joints stand, (n, m), if not where they are said to.
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
    """The signals of the drawing's machine under these conditions."""
    g, signals = mechanism.parameters.nominal, recorded(mechanism, at)
    x = mechanism.forward(at.joint, g)
    return standing(signals, robot, mechanism, x, g, asked)
