"""What data leave open of the shape in which a cause was found: frequency, time constant, moment.

A field of the shape that was searched is a nuisance to the values: it may be anywhere that was
tried, and data hold it as far as chi square rises away from where it was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.candidates import (
    Candidate,
    moved_by,
    products_of,
    shape_columns,
)
from delta_calibration.diagnosis.columns import Plain, joined
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.effects import Effect, Interval

Array = NDArray[np.float64]

_LEAST, _HALVINGS = 3e-4, 8  # of a field's spread; of the logarithm of a distance
_ALIKE = 2.0  # factor within which a rise is as a straight line has it
_RANK = 1e-9  # share of the largest direction under which values are not told


@dataclass(frozen=True)
class OpenShape:
    """How a cause's signal goes with the searched fields, and what is known of these beforehand.

    In units of the spread of a field that lies anywhere in its interval.
    """

    columns: Array  # (d n, fields) whitened
    precision: Array  # (fields,) of the priors


def open_shape(
    term: Candidate, evidence: LinearizedModel, scaled: Array, misfit: float
) -> OpenShape:
    """What is left open of the shape of a cause that was found.

    A slope is that over the distance at which chi square has risen by one: a moment between two
    samples moves nothing, and a sample further everything.

    Args:
        term: the cause, in the shape that was found.
        evidence: beside all else that is fitted.
        scaled: its values in units of their priors, (k,).
        misfit: chi square per degree of freedom.
    """
    effect = term.effect
    if effect is None:
        return OpenShape(np.zeros((evidence.size, 0)), np.zeros(0))
    columns, tried = shape_columns(term, evidence, scaled), tried_of(effect, evidence.at)
    width = np.ones(columns.shape[1])
    for i, (name, low, high) in enumerate(effect.bounded_intervals()):
        within = tried[name]
        width[i] = (within[1] - within[0]) / (high - low)
        field = _Field(term, evidence, scaled, misfit, (name, low, high), within)
        columns[:, i] = field.slope(columns[:, i])
    return OpenShape(columns, 1 / width**2)


def tried_of(effect: Effect, at: Conditions) -> Mapping[str, tuple[float, float]]:
    """From where to where each searched field was looked for, by name."""
    own = {name: (low, high) for name, low, high in effect.bounded_intervals()}
    for shape in effect.shapes(at) if own else ():
        for name, low, high in shape.bounded_intervals():
            if name in own:
                own[name] = min(own[name][0], low), max(own[name][1], high)
    return own


@dataclass(frozen=True)
class _Field:
    """One searched field of a cause that was found, the others as they are."""

    term: Candidate
    evidence: LinearizedModel
    scaled: Array
    misfit: float
    interval: Interval
    within: tuple[float, float]  # where it was looked for

    def slope(self, tangent: Array) -> Array:
        """By the spread of the field, (d n,): the tangent, where chi square rises as it foretells.

        Else the secant between the nearest values on either side that chi square tells from the
        one that was found, or all that were tried; no surer than these are near.
        """
        spread, told = self._spread, self._fit(tangent, self.term)[1]
        rooms = self._now - self.within[0], self.within[1] - self._now
        sides = [(sign, room) for sign, room in zip((-1, 1), rooms, strict=True) if room > 0]
        far = spread / max(np.sqrt(told), 1e-300)
        if all(far < room and _straight(self._rise(sign * far)) for sign, room in sides):
            return tangent
        ends = [self._end(sign, room) for sign, room in sides]
        width, near = float(np.ptp([0.0, *ends])), float(np.mean(np.abs(ends)))
        left, along = self._between(self._at(min(0.0, *ends)), self._at(max(0.0, *ends)))
        told = self._fit(left, self.term)[1]
        left *= min(1.0, width / near / max(np.sqrt(told), 1e-300))
        return np.asarray((left + along) * spread / width)

    def _between(self, before: Candidate, after: Candidate) -> tuple[Array, Array]:
        """How the signal goes from one shape to another, two (d n,).

        What the values cannot follow; and as they would, going from the best of one to the best
        of the other.
        """
        first, last = (moved_by(shape, self.evidence, self.scaled) for shape in (before, after))
        begin, end = (self._fit(self._found, shape)[0] for shape in (before, after))
        follows = self._fit(last - first, self.term)[0]
        own = products_of(self.term, self.evidence)
        left = last - first - own.times(follows[:, None])[:, 0]
        return left, own.times((begin - end)[:, None])[:, 0]

    def _end(self, sign: int, room: float) -> float:
        """Where chi square has risen by one, on one side; all the room if it never does."""
        least, most = _LEAST * self._spread, room
        if most <= least or self._rise(sign * most) <= 1:
            return sign * most
        for _ in range(_HALVINGS):
            middle = float(np.sqrt(least * most))
            told = self._rise(sign * middle) > 1
            least, most = (least, middle) if told else (middle, most)
        return sign * most

    @property
    def _now(self) -> float:
        return float(getattr(self.term.effect, self.interval[0]))

    @property
    def _spread(self) -> float:
        """Of a field that lies anywhere in its interval."""
        return (self.interval[2] - self.interval[1]) / 12**0.5

    @cached_property
    def _found(self) -> Array:
        return moved_by(self.term, self.evidence, self.scaled)

    def _rise(self, by: float) -> float:
        """Of chi square, where the field is off by so much and the values follow as they can."""
        return self._fit(self._found, self._at(by))[1]

    def _at(self, by: float) -> Candidate:
        """The cause with the field off by so much."""
        value = float(np.clip(self._now + by, *self.within))
        field: dict[str, Any] = {self.interval[0]: value}
        effect: Effect = replace(cast(Any, self.term.effect), **field)
        return replace(self.term, effect=effect)

    def _fit(self, column: Array, cause: Candidate) -> tuple[Array, float]:
        """A column (d n,) by a cause: its values (k,), and chi square of what they leave."""
        both = joined([products_of(cause, self.evidence), Plain(column[:, None])])
        known = self.evidence.information_of(both)
        own, across = known[:-1, :-1], known[:-1, -1]
        value = np.asarray(np.linalg.lstsq(own, across, rcond=_RANK)[0])
        return value, max(0.0, float(known[-1, -1] - across @ value)) / self.misfit


def _straight(rise: float) -> bool:
    """Whether chi square rises about by the one that a straight line has it rise by."""
    return 1 / _ALIKE <= rise <= _ALIKE
