"""Structure that nothing in the catalogue explains: smooth maps of what it moves with.

No cause is claimed. Each joint is moved by a smooth function of where the machine stands, and of
one condition times a plane over the joints:

    dq_j = sum_f w_jf phi_f(q)       phi: bumps about places of the session (position),
                                     bumps along each joint's angle alone (joint angle),
                                     condition(c) * (1, q_1, ..., q_m)       (all others), or
                                     condition(c) * bumps about places       (payload)

Joint space serves for all: where the mechanism is regular, any displacement of its platform is
one of its joints. The bumps with a normal prior on their weights are a Gaussian process seen from
its inducing points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy.spatial.distance import cdist

from delta_calibration.effects.base import SPREAD, Array, Effect, Stage
from delta_calibration.effects.thermal_growth import REFERENCE
from delta_calibration.effects.time_course import HOUR
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.samples import Conditions

UNEXPLAINED = "unexplained"
POSITION, JOINT, DIRECTION, PAYLOAD, TIME, TEMPERATURE, SPEED = (
    "position",
    "joint angle",
    "direction",
    "payload",
    "time",
    "temperature",
    "speed",
)
FAMILIES = (POSITION, JOINT, DIRECTION, PAYLOAD, TIME, TEMPERATURE, SPEED)
_CENTRES = 40
SIZES = (3e-6, 10e-6, 30e-6, 100e-6, 300e-6)  # [rad]
WIDE, NARROW, FLAT = 0.5, 0.25, 0.0  # width of a bump over the spread of the places; 0: a plane
_BUMPS = {POSITION: (WIDE, NARROW), PAYLOAD: (FLAT, NARROW)}
_ALONG = 12  # bumps along a joint's angle


@dataclass(frozen=True)
class Unexplained(Effect):
    """A smooth map over `family`; `centres` are the places of its bumps, (f m,) in a row."""

    cause: ClassVar[str] = UNEXPLAINED
    kind: ClassVar[str] = "unknown"
    stage: ClassVar[Stage] = Stage.DRIVE

    family: str = POSITION
    size: float = SIZES[-1]  # [rad] standard deviation of a weight, before anything is known
    width: float = 0.0  # [rad] of a bump
    centres: tuple[float, ...] = ()

    @classmethod
    def over(
        cls,
        effect_of: Effect,
        family: str,
        joint: Array,
        size: float = SIZES[-1],
        reach: float | None = None,
    ) -> Unexplained:
        """The map of a family over a session's places, (n, m) [rad].

        Args:
            effect_of: any effect on the mechanism.
            family: what it moves with.
            joint: the places.
            size: of its weights [rad].
            reach: width of its bumps over the spread of the places, one of `reaches`; 0 for none.
        """
        bare = cls(effect_of.robot, effect_of.mechanism, family, size)
        if family == JOINT:
            low, high = joint.min(axis=0), joint.max(axis=0)
            step = float((high - low).max()) / (_ALONG - 1)
            return bare._about(np.linspace(low, high, _ALONG), step)
        reach = reaches(family)[0] if reach is None else reach
        if reach == FLAT:
            return bare
        spread = float(np.linalg.norm(joint.std(axis=0)) * np.sqrt(2))
        return bare._about(spread_out(joint, _CENTRES), reach * spread)

    def _about(self, centres: Array, width: float) -> Unexplained:
        """The map with bumps about places (f, m)."""
        flat = tuple(np.round(centres, 6).ravel().tolist())
        return replace(self, width=width, centres=flat)

    @property
    def parameters(self) -> ParameterSet:
        """Weights [rad] of each feature at each joint."""
        m = self.mechanism.joints
        count = len(self.centres) if self.family == JOINT else len(self.centres) // m
        count = count or self._conditions * (m + 1)
        return _weights(self.family.replace(" ", "_"), count, m, self.size / SPREAD)

    def wrong(self) -> str:
        """A family that there is, and bumps where it has any."""
        if self.family not in FAMILIES:
            return f"family: {self.family!r} is not allowed; choose from: {', '.join(FAMILIES)}"
        bumps = bool(self.centres)
        for name, value in (("size", self.size), ("width", self.width)):
            if not 0 < value < np.inf and (bumps or name == "size"):
                return f"{name}: {value} is not allowed; more than 0"
        wanted = {POSITION: (True,), JOINT: (True,), PAYLOAD: (True, False)}
        whole = len(self.centres) % self.mechanism.joints == 0
        fitting = bumps in wanted.get(self.family, (False,))
        if not (whole and fitting and np.isfinite(self.centres).all()):
            return f"centres: {len(self.centres)} numbers are not allowed; one a joint and bump"
        return ""

    @property
    def bound_to_session(self) -> bool:
        """Where it goes by the clock."""
        return self.family == TIME

    def missing(self, at: Conditions) -> str:
        """The condition that it moves with."""
        if self.family == PAYLOAD and not np.isfinite(at.payload).all():
            return "the payload is not known"
        known = at.temperature.shape[1] > 0 and np.isfinite(at.temperature[:, 0]).all()
        if self.family == TEMPERATURE and not known:
            return "no temperature is known"
        return ""

    @property
    def _conditions(self) -> int:
        return self.mechanism.joints if self.family in (DIRECTION, SPEED) else 1

    def columns(self, at: Conditions) -> Array:
        """(n, m, f m)."""
        features = self._features(at)
        each = features[:, None, :, None] * np.eye(at.joint.shape[1])[:, None, :]
        return np.asarray(each.reshape(len(at), at.joint.shape[1], -1))

    def _features(self, at: Conditions) -> Array:
        """(n, f)."""
        if self.family == JOINT:
            centres = np.reshape(self.centres, (-1, at.joint.shape[1]))
            apart = at.joint[:, :, None] - centres.T
            return np.asarray(np.exp(-(apart**2) / (2 * self.width**2)).reshape(len(at), -1))
        if self.family == POSITION:
            return self._shape(at)
        each = self._condition(at)[:, :, None] * self._shape(at)[:, None, :]
        return np.asarray(each.reshape(len(at), -1))

    def _shape(self, at: Conditions) -> Array:
        """Bumps, or a plane where there are none, over the joints, (n, f)."""
        if not self.centres:
            return np.column_stack([np.ones(len(at)), at.joint])
        centres = np.reshape(self.centres, (-1, at.joint.shape[1]))
        near = cdist(at.joint, centres, "sqeuclidean")
        return np.asarray(np.exp(-near / (2 * self.width**2)))

    def _condition(self, at: Conditions) -> Array:
        """(n, conditions), of the order of one."""
        if self.family == DIRECTION:
            return at.direction
        if self.family == SPEED:
            return at.velocity
        if self.family == PAYLOAD:
            return at.payload[:, None]
        if self.family == TEMPERATURE:
            return (at.temperature[:, :1] - REFERENCE) / 10.0
        return at.time[:, None] / HOUR


@lru_cache
def _weights(word: str, features: int, joints: int, prior: float) -> ParameterSet:
    """Of each feature at each joint; there are many, and they are asked for often."""
    return ParameterSet(
        tuple(
            Parameter(f"{word}_{f}_{j}", "rad", 0.0, prior, UNEXPLAINED, None)
            for f in range(1, features + 1)
            for j in range(1, joints + 1)
        )
    )


def spread_out(places: Array, count: int) -> Array:
    """So many of the places, each the farthest from those before it, (count, m)."""
    chosen = [int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < min(count, len(places)) and distance.max() > 0:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return places[chosen]


def reaches(family: str) -> tuple[float, ...]:
    """Widths of bumps that a family is tried with, over the spread of the places."""
    return _BUMPS.get(family, (FLAT,))


def families(at: Conditions) -> Iterator[str]:
    """What structure could move with in such data."""
    yield POSITION
    yield JOINT
    if (np.ptp(at.direction, axis=0) > 0).any():
        yield DIRECTION
    if np.isfinite(at.payload).all() and np.ptp(at.payload) > 0:
        yield PAYLOAD
    yield TIME
    if at.temperature.shape[1] and np.ptp(at.temperature[:, 0]) > 0:
        yield TEMPERATURE
    if (at.velocity != 0).any():
        yield SPEED
