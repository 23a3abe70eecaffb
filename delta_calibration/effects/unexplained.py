"""Smooth maps of errors that nothing in the catalogue explains.

No cause is claimed. Each joint is moved by a smooth function of the joint coordinates, or by one
condition times a plane (or bumps) over the joints:

    dq_j = sum_f w_jf phi_f(q)       phi: bumps about places of the session (position),
                                     bumps along each joint's angle alone (joint angle),
                                     condition(c) * (1, q_1, ..., q_m)       (all others), or
                                     condition(c) * bumps about places       (payload)

The whole is multiplied by 1 within the joint range that it was learned in, and beyond it by

    prod_j exp(-(d_j / r_j)^2)       d_j: how far joint j is beyond its range, r_j: a twentieth
                                     of that range

because nothing is known where nothing was measured. q and its rate are in units of `joint_size` s
(q of sliders from home), and w is of the order of `SIZES` times s: with the mechanism's own s, a
map of a given size moves the platform of any mechanism by about the same amount.

A map over the joints suffices: where the mechanism is regular, any displacement of its platform
corresponds to one of its joints. The bumps with a normal prior on their weights are a Gaussian
process represented by its inducing points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects import signals
from delta_calibration.effects.base import NO_PAYLOAD, SPREAD, Array, Effect, Stage, terms_of
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
_AGAINST = {SPEED: VELOCITY, TIME: CLOCK, PAYLOAD: LOAD}  # horizontal axis of a map's picture
_SIGNALS = {  # signal that a map depends on
    DIRECTION: signals.DIRECTION,
    SPEED: signals.RATE,
    PAYLOAD: signals.PAYLOAD,
    TIME: signals.TIME,
    TEMPERATURE: signals.TEMPERATURE,
}
_SCALES = {TIME: (0.0, 1 / HOUR), TEMPERATURE: (REFERENCE, 0.1)}  # offset and scale
_ALONG = 12  # bumps along a joint's angle
_DIGITS = 1e6  # the range is rounded outward to 1 / _DIGITS
_FADING = 0.05  # share of a joint's range over which a map fades beyond it
_LEAST = 1e-3  # [rad of a Delta] smallest such fading length, for a joint that stood still


@dataclass(frozen=True)
class Unexplained(Effect):
    """A smooth map over `family`; `centres` are the places of its bumps, (f m,) in a row.

    Older files hold no `joint_size`: it is then 0, places and speeds are unscaled, and weights are
    stated in rad. Still older files hold no range either: their maps do not fade.
    """

    cause: ClassVar[str] = UNEXPLAINED
    remedy: ClassVar[Remedy] = Remedy(
        MEASURE,
        "machine",
        "make the measurement that the verdict proposes",
        "repeat the session: an error of the machine appears again",
    )
    kind: ClassVar[str] = "unknown"
    called: ClassVar[str] = "smooth map"
    stage: ClassVar[Stage] = Stage.DRIVE
    free_form: ClassVar[bool] = True
    by_functions: ClassVar[bool] = True

    family: str = POSITION
    # all in the joints' unit
    size: float = SIZES[-1]  # prior standard deviation of a weight
    width: float = 0.0  # of a bump
    centres: tuple[float, ...] = ()
    joint_size: float = 0.0  # unit of places and speeds in the features
    lower: tuple[float, ...] = ()  # (m,) lower end of the range that it was learned in
    upper: tuple[float, ...] = ()  # (m,) upper end

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
            family: quantity that the map depends on, one of `FAMILIES`.
            joint: the places, (n, m).
            size: prior standard deviation of its weights [rad of a Delta].
            reach: width of its bumps over the spread of the places, one of `reaches`; 0 for none.
            seen: all joint coordinates that it is learned from, also in motion, (k, m); by default
                the places.
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
        """Check the family, sizes and range, and that bumps are given if the family has them."""
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
        """Whether the map depends on time."""
        return self.family == TIME

    def missing(self, at: Conditions) -> str:
        """The condition that the map depends on, if it is not known."""
        if self.family == PAYLOAD and not np.isfinite(at.payload).all():
            return NO_PAYLOAD
        known = at.temperature.shape[1] > 0 and np.isfinite(at.temperature[:, 0]).all()
        if self.family == TEMPERATURE and not known:
            return "no temperature is known"
        return ""

    @property
    def moves_with(self) -> str | None:
        """Its family."""
        return self.family

    def regressor(self, at: Conditions) -> Regressor:
        """Quantity of the family; the joint's angle for maps over joints, places, directions."""
        if self.family == TEMPERATURE:
            return temperature(at.temperature_parts[0])
        return _AGAINST.get(self.family, ANGLE)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups by direction if the map depends on it; else one group."""
        return by_direction(at, joint) if self.family == DIRECTION else all_together(at)

    @property
    def _conditions(self) -> int:
        return self.mechanism.joints if self.family in (DIRECTION, SPEED) else 1

    @property
    def _unit(self) -> float:
        """Unit of places and speeds in the features, in the joints' unit."""
        return self.joint_size or 1.0

    @property
    def takes(self) -> tuple[str, ...]:
        """Joint coordinates, and the signal of the family; see `terms`."""
        return (signals.JOINT, _SIGNALS.get(self.family, NOTHING))

    @property
    def variant(self) -> str:
        """Bumps or plane, over one joint or all m, and the number of joints that they move."""
        m = self.mechanism.joints
        if self.family == JOINT:
            return f"_bump_1_{m}"
        return f"_{'bump' if self.centres else 'plane'}_{m}_{m}"

    @property
    def law(self) -> Callable[..., Any]:  # type: ignore[override]
        """Law of a bump or of a plane."""
        return _bump if self.centres else _plane

    def functions(self, signals: Signals) -> Array:
        """Its bumps, or products of condition and joint, at each sample, (n, F)."""
        weights = np.ones(len(self.parameters))
        return terms_of((self,), signals.places).firsts(signals, weights)

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per feature, which moves every joint by its own weight."""
        m = self.mechanism.joints
        features = self._bumps(places) if self.centres else self._planes(places)
        for f, (own, constants) in enumerate(features):
            yield Term(own, tuple(range(f * m, f * m + m)), tuple(range(m)), constants)

    def _bumps(self, places: Places) -> Iterator[tuple[tuple[int, ...], tuple[float, ...]]]:
        """Signals (joints, condition) and constants of each bump, and whether it is weighted.

        The constant that follows the width is 1 if the condition multiplies the bump, else 0.
        """
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
        """Signals and constants of a plane's features: for each condition 1, then each joint."""
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
        """Lower and upper ends of some joints' ranges, and fading rates beyond them, (3 k,)."""
        if not self.lower:
            zero = (0.0,) * len(range(*joints.indices(self.mechanism.joints)))
            return (*zero, *zero, *zero)  # at rate 0 the map does not fade anywhere
        low, high = np.array(self.lower[joints]), np.array(self.upper[joints])
        rate = 1 / np.maximum(_FADING * (high - low), _LEAST * self._unit)
        return (*low.tolist(), *high.tolist(), *rate.tolist())

    @property
    def _middle(self) -> list[float]:
        """Drive readings at the origin of a plane: home for sliders, as their zero is far away."""
        slides = self.joint_size and self.mechanism.joint_unit == "m"
        middle = self.mechanism.home if slides else self.mechanism.drives.zero
        return [float(value) for value in middle]


def _bump(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
    """w exp(-|q - c|^2 / 2 width^2) times fading, and times the condition for some families."""
    m = s.shape[0] - 1
    counts = c[m + 1]
    condition = where(counts > 0, s[m], 1.0)
    near = square(s[:m] - c[:m]) * c[m] + _beyond(s[:m], c[m + 2 :])
    return v * (condition * exp(-near))


def _plane(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
    """w times condition times feature, each relative to its middle and in its unit; faded."""
    m = s.shape[0] - 2
    whole = (s[m] - c[0]) * c[1] * ((s[m + 1] - c[2]) * c[3])
    return v * (whole * exp(-_beyond(s[:m], c[4:])))


def _beyond(q: Symbol, c: Symbol) -> Symbol:
    """Sum of squared joint distances beyond the ranges, in units of the fading lengths."""
    m = q.shape[0]
    total = 0.0
    for j in range(m):
        by = maximum(maximum(c[j] - q[j], q[j] - c[m + j]), 0.0) * c[2 * m + j]
        total = total + by * by
    return total


def _told(values: Array) -> tuple[float, ...]:
    """Numbers rounded as stored in a file, in the joints' unit."""
    return tuple(np.round(values, 6).tolist())


@lru_cache
def _weights(word: str, features: int, joints: int, prior: float, unit: str) -> ParameterSet:
    """Weights of each feature at each joint; cached, as they are many and often requested."""
    return ParameterSet(
        tuple(
            Parameter(f"{word}_{f}_{j}", unit, 0.0, prior, UNEXPLAINED, None)
            for f in range(1, features + 1)
            for j in range(1, joints + 1)
        )
    )


def spread_out(places: Array, count: int) -> Array:
    """Up to `count` of the places, each the farthest from those before it, (count, m)."""
    chosen = [int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < min(count, len(places)) and distance.max() > 0:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return places[chosen]


def reaches(family: str) -> tuple[float, ...]:
    """Bump widths to try for a family, relative to the spread of the places."""
    return _BUMPS.get(family, (FLAT,))


def families(at: Conditions) -> Iterator[str]:
    """Yield the families that such data could show: quantities that vary in them."""
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
