"""Structure that nothing in the catalogue explains: smooth maps of what it moves with.

No cause is claimed. Each joint is moved by a smooth function of where the machine stands, and of
one condition times a plane over the joints:

    dq_j = sum_f w_jf phi_f(q)       phi: bumps about places of the session (position),
                                     bumps along each joint's angle alone (joint angle),
                                     condition(c) * (1, q_1, ..., q_m)       (all others), or
                                     condition(c) * bumps about places       (payload)

and all of it times 1 within the joint angles that it was learned at, less beyond them,

    prod_j exp(-(d_j / r_j)^2)       d_j: how far joint j is beyond its range, r_j: a twentieth
                                     of that range

as a map knows nothing of where nothing was measured. q and its rate are in units of `joint_size` s
(q of sliders from home), and w of the order of `SIZES` times s: with s the mechanism's own, a map
of a given size moves the platform of any mechanism by about as much.

Joint space serves for all: where the mechanism is regular, any displacement of its platform is
one of its joints. The bumps with a normal prior on their weights are a Gaussian process seen from
its inducing points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects import signals
from delta_calibration.effects.base import SPREAD, Array, Effect, Stage, terms_of
from delta_calibration.effects.regressor import (
    ANGLE,
    CLOCK,
    LOAD,
    VELOCITY,
    Groups,
    Regressor,
    all_together,
    by_direction,
    temperature,
)
from delta_calibration.effects.remedy import MEASURE, Remedy
from delta_calibration.effects.signals import NOTHING, Places, Signals
from delta_calibration.effects.thermal_growth import REFERENCE
from delta_calibration.effects.time_course import HOUR
from delta_calibration.model.symbols import Symbol, exp, maximum, square, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import Parameter, ParameterSet

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
SIZES = (3e-6, 10e-6, 30e-6, 100e-6, 300e-6)  # [rad of a Delta]: times the joint size
WIDE, NARROW, FLAT = 0.5, 0.25, 0.0  # width of a bump over the spread of the places; 0: a plane
_BUMPS = {POSITION: (WIDE, NARROW), PAYLOAD: (FLAT, NARROW)}
_AGAINST = {SPEED: VELOCITY, TIME: CLOCK, PAYLOAD: LOAD}  # what a map is drawn against
_SIGNALS = {  # what a map moves with
    DIRECTION: signals.DIRECTION,
    SPEED: signals.RATE,
    PAYLOAD: signals.PAYLOAD,
    TIME: signals.TIME,
    TEMPERATURE: signals.TEMPERATURE,
}
_SCALES = {TIME: (0.0, 1 / HOUR), TEMPERATURE: (REFERENCE, 0.1)}  # offset and scale
_ALONG = 12  # bumps along a joint's angle
_DIGITS = 1e6  # of places, in a file
_FADING = 0.05  # of a joint's range, over which a map fades beyond it
_LEAST = 1e-3  # [rad of a Delta] the same of a joint that stood still


@dataclass(frozen=True)
class Unexplained(Effect):
    """A smooth map over `family`; `centres` are the places of its bumps, (f m,) in a row.

    Files of versions that knew no `joint_size` hold none: theirs is 0, for places and speeds taken
    as they are and weights said to be in rad. Those that knew no range have none.
    """

    cause: ClassVar[str] = UNEXPLAINED
    remedy: ClassVar[Remedy] = Remedy(
        MEASURE,
        "machine",
        "measure what the verdict proposes",
        "repeat the session: what comes back is the machine's",
    )
    kind: ClassVar[str] = "unknown"
    called: ClassVar[str] = "smooth map"
    stage: ClassVar[Stage] = Stage.DRIVE
    free_form: ClassVar[bool] = True
    by_functions: ClassVar[bool] = True

    family: str = POSITION
    # all in the joints' unit
    size: float = SIZES[-1]  # standard deviation of a weight, before anything is known
    width: float = 0.0  # of a bump
    centres: tuple[float, ...] = ()
    joint_size: float = 0.0  # that counts as one where a feature is a place or a speed
    lower: tuple[float, ...] = ()  # (m,) joints that it was learned at, and is to be used at
    upper: tuple[float, ...] = ()  # (m,)

    @classmethod
    def over(
        cls,
        effect_of: Effect,
        family: str,
        joint: Array,
        size: float = SIZES[-1],
        reach: float | None = None,
        seen: Array | None = None,
    ) -> Unexplained:
        """The map of a family over a session's places, (n, m) in the joints' unit.

        Args:
            effect_of: any effect on the mechanism.
            family: what it moves with.
            joint: the places.
            size: of its weights [rad of a Delta].
            reach: width of its bumps over the spread of the places, one of `reaches`; 0 for none.
            seen: all joints that it is learned at, in motion too, (k, m); the places where not
                given.
        """
        seen = joint if seen is None else seen
        mechanism = effect_of.mechanism
        own = mechanism.joint_size
        bare = cls(
            effect_of.robot,
            mechanism,
            family,
            size * own,
            joint_size=own,
            lower=_told(np.floor(seen.min(axis=0) * _DIGITS) / _DIGITS),
            upper=_told(np.ceil(seen.max(axis=0) * _DIGITS) / _DIGITS),
        )
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
        return replace(self, width=width, centres=_told(centres.ravel()))

    @property
    def parameters(self) -> ParameterSet:
        """Weights of each feature at each joint, in the joints' unit."""
        m = self.mechanism.joints
        count = len(self.centres) if self.family == JOINT else len(self.centres) // m
        count = count or self._conditions * (m + 1)
        unit = self.mechanism.joint_unit if self.joint_size else "rad"
        return _weights(self.family.replace(" ", "_"), count, m, self.size / SPREAD, unit)

    def wrong(self) -> str:
        """A family that there is, and bumps where it has any."""
        if self.family not in FAMILIES:
            return f"family: {self.family!r} is not allowed; choose from: {', '.join(FAMILIES)}"
        bumps = bool(self.centres)
        for name, value in (("size", self.size), ("width", self.width)):
            if not 0 < value < np.inf and (bumps or name == "size"):
                return f"{name}: {value} is not allowed; more than 0"
        if not 0 <= self.joint_size < np.inf:
            return f"joint_size: {self.joint_size} is not allowed; 0 or more"
        ends = {len(self.lower), len(self.upper)}
        if ends not in ({0}, {self.mechanism.joints}):
            return f"lower, upper: {ends} numbers are not allowed; {self.mechanism.joints} each"
        if not all(low <= high for low, high in zip(self.lower, self.upper, strict=True)):
            return f"lower: {self.lower} is not allowed; not above upper, {self.upper}"
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
    def moves_with(self) -> str | None:
        """Its family."""
        return self.family

    def regressor(self, at: Conditions) -> Regressor:
        """What it moves with; the joint's angle for maps over joints, places or directions."""
        if self.family == TEMPERATURE:
            return temperature(at.temperature_parts[0])
        return _AGAINST.get(self.family, ANGLE)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """By direction where it moves with that."""
        return by_direction(at, joint) if self.family == DIRECTION else all_together(at)

    @property
    def _conditions(self) -> int:
        return self.mechanism.joints if self.family in (DIRECTION, SPEED) else 1

    @property
    def _unit(self) -> float:
        """What counts as one of places and speeds, in the joints' unit."""
        return self.joint_size or 1.0

    @property
    def takes(self) -> tuple[str, ...]:
        """Places, and what it moves with; see `terms`."""
        return (signals.JOINT, _SIGNALS.get(self.family, NOTHING))

    @property
    def variant(self) -> str:
        """Bumps over so many joints, along one joint, or a plane; how many joints they move."""
        m = self.mechanism.joints
        if self.family == JOINT:
            return f"_bump_1_{m}"
        return f"_{'bump' if self.centres else 'plane'}_{m}_{m}"

    @property
    def law(self) -> Callable[..., Any]:  # type: ignore[override]
        """Of a bump or of a plane."""
        return _bump if self.centres else _plane

    def functions(self, signals: Signals) -> Array:
        """Its bumps, or products of condition and joint, at each sample, (n, F)."""
        weights = np.ones(len(self.parameters))
        return terms_of((self,), signals.places).firsts(signals, weights)

    def terms(self, places: Places) -> Iterator[Term]:
        """One for each feature, which moves every joint by a weight of its own."""
        m = self.mechanism.joints
        features = self._bumps(places) if self.centres else self._planes(places)
        for f, (own, constants) in enumerate(features):
            yield Term(own, tuple(range(f * m, f * m + m)), tuple(range(m)), constants)

    def _bumps(self, places: Places) -> Iterator[tuple[tuple[int, ...], tuple[float, ...]]]:
        """Signals and constants of each bump: places, condition; whether that counts."""
        m, first = self.mechanism.joints, places.begin(signals.JOINT)
        narrow = 1 / (2 * self.width**2)
        centres = np.reshape(self.centres, (-1, m))
        if self.family == JOINT:
            nothing = places.begin(NOTHING)
            for j in range(m):
                ends = self._ends(slice(j, j + 1))
                for centre in centres[:, j].tolist():
                    yield (first + j, nothing), (centre, narrow, 0.0, *ends)
            return
        condition = places.begin(_SIGNALS.get(self.family, NOTHING))
        counts = float(self.family == PAYLOAD)
        ends = self._ends(slice(0, m))
        for own in centres.tolist():
            yield (*range(first, first + m), condition), (*own, narrow, counts, *ends)

    def _planes(self, places: Places) -> Iterator[tuple[tuple[int, ...], tuple[float, ...]]]:
        """Of each condition the plane's features: 1, then each joint; offsets and scales."""
        m = self.mechanism.joints
        first, nothing = places.begin(signals.JOINT), places.begin(NOTHING)
        begin, middle = places.begin(_SIGNALS[self.family]), self._middle
        offset, scale = _SCALES.get(self.family, (0.0, 1.0))
        scale = 1 / self._unit if self.family == SPEED else scale
        joints, ends = range(first, first + m), self._ends(slice(0, m))
        for i in range(self._conditions):
            yield (*joints, begin + i, nothing), (offset, scale, -1.0, 1.0, *ends)
            for j in range(m):
                own = offset, scale, middle[j], 1 / self._unit
                yield (*joints, begin + i, first + j), (*own, *ends)

    def _ends(self, joints: slice) -> tuple[float, ...]:
        """Of some joints the ends of their ranges, and how fast it fades beyond them, (3 k,)."""
        if not self.lower:
            zero = (0.0,) * len(range(*joints.indices(self.mechanism.joints)))
            return (*zero, *zero, *zero)  # at no rate: nowhere less than whole
        low, high = np.array(self.lower[joints]), np.array(self.upper[joints])
        rate = 1 / np.maximum(_FADING * (high - low), _LEAST * self._unit)
        return (*low.tolist(), *high.tolist(), *rate.tolist())

    @property
    def _middle(self) -> list[float]:
        """What drives read where a joint counts as 0 in a plane: sliders at home, zero is far."""
        slides = self.joint_size and self.mechanism.joint_unit == "m"
        middle = self.mechanism.home if slides else self.mechanism.drives.zero
        return [float(value) for value in middle]


def _bump(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
    """w exp(-|q - c|^2 / 2 width^2), times the condition if that counts."""
    m = s.shape[0] - 1
    counts = c[m + 1]
    condition = where(counts > 0, s[m], 1.0)
    near = square(s[:m] - c[:m]) * c[m] + _beyond(s[:m], c[m + 2 :])
    return v * (condition * exp(-near))


def _plane(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
    """w times condition and feature, each less its middle and in its unit."""
    m = s.shape[0] - 2
    whole = (s[m] - c[0]) * c[1] * ((s[m + 1] - c[2]) * c[3])
    return v * (whole * exp(-_beyond(s[:m], c[4:])))


def _beyond(q: Symbol, c: Symbol) -> Symbol:
    """Sum of the squares by which joints are beyond their ranges, in what it fades by."""
    m = q.shape[0]
    total = 0.0
    for j in range(m):
        by = maximum(maximum(c[j] - q[j], q[j] - c[m + j]), 0.0) * c[2 * m + j]
        total = total + by * by
    return total


def _told(values: Array) -> tuple[float, ...]:
    """Numbers as a file holds them, in the joints' unit."""
    return tuple(np.round(values, 6).tolist())


@lru_cache
def _weights(word: str, features: int, joints: int, prior: float, unit: str) -> ParameterSet:
    """Of each feature at each joint; there are many, and they are asked for often."""
    return ParameterSet(
        tuple(
            Parameter(f"{word}_{f}_{j}", unit, 0.0, prior, UNEXPLAINED, None)
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
