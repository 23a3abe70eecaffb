"""Uncertainty of the searched shape of a cause: of its frequency, time constant or moment.

A searched field of the shape is a nuisance parameter of the values. Its prior is the range that
was tried; the data determine it as far as chi square rises away from the value that was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from delta_calibration.diagnosis.constants import RISE
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.effects import Effect, Interval
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]

_LEAST, _HALVINGS = 3e-4, 8  # least distance, in spreads of the field; bisections of its logarithm
_ALIKE = 2.0  # factor within which a rise of chi square agrees with the tangent's
_RANK = 1e-9  # share of the largest singular value under which a direction is not identifiable


@dataclass(frozen=True)
class OpenShape:
    """Columns of a cause's signal by its searched fields, and the priors of these fields.

    The unit of a field is the standard deviation of a uniform distribution over its interval.
    """

    columns: Array  # (d n, fields) whitened
    precision: Array  # (fields,) of the priors


def open_shape(
    term: Candidate, evidence: LinearizedModel, scaled: Array, misfit: float
) -> OpenShape:
    """Columns and priors of the searched fields of a cause that was found.

    A slope is a secant between the ends of the field's 95 % interval, where the profile of chi
    square has risen by 1.96^2: a moment that moves between two samples changes nothing, but one
    sample further it changes everything.

    Args:
        term: the cause, in the shape that was found.
        evidence: the evidence with all other fitted parameters in its nuisance.
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
    """Lowest and highest value that was tried for each searched field, by name.

    The value that was found is among them; of a field that no shape has, its own interval is.
    """
    own, tried = effect.bounded_intervals(), dict[str, list[float]]()
    for shape in effect.shapes(at) if own else ():
        for name, low, high in shape.bounded_intervals():
            tried.setdefault(name, []).extend((low, high))
    found = {name: tried.get(name, [low, high]) for name, low, high in own}
    ranges = {name: [*ends, getattr(effect, name)] for name, ends in found.items()}
    return {name: (min(ends), max(ends)) for name, ends in ranges.items()}


@dataclass(frozen=True)
class _Field:
    """One searched field of a cause that was found; the other fields keep their values."""

    term: Candidate
    evidence: LinearizedModel
    scaled: Array
    misfit: float
    interval: Interval
    within: tuple[float, float]  # lowest and highest value that was tried

    def slope(self, tangent: Array) -> Array:
        """Slope of the signal by the field in its spread, (d n,): tangent if chi square agrees.

        Else the secant between the ends of the field's 95 % interval, or of the range tried. It is
        scaled down if it would determine the field better than these ends do.
        """
        spread, told = self._spread, self._fit(tangent, self.term)[1]
        rooms = self._now - self.within[0], self.within[1] - self._now
        sides = [(sign, room) for sign, room in zip((-1, 1), rooms, strict=True) if room > 0]
        far = spread * np.sqrt(RISE / max(told, 1e-300))
        if all(far < room and _straight(self._rise(sign * far)) for sign, room in sides):
            return tangent
        ends = [self._end(sign, room) for sign, room in sides]
        width, near = float(np.ptp([0.0, *ends])), float(np.mean(np.abs(ends)))
        left, along = self._between(self._at(min(0.0, *ends)), self._at(max(0.0, *ends)))
        told = self._fit(left, self.term)[1]
        left *= min(1.0, width / near * np.sqrt(RISE / max(told, 1e-300)))
        return np.asarray((left + along) * spread / width)

    def _between(self, before: Candidate, after: Candidate) -> tuple[Array, Array]:
        """Change of the signal from one shape to another, in two parts of (d n,) each.

        The first is the part that the values cannot follow; the second is the change that the
        values make between their best fit in one shape and in the other.
        """
        first, last = (moved_by(shape, self.evidence, self.scaled) for shape in (before, after))
        begin, end = (self._fit(self._found, shape)[0] for shape in (before, after))
        follows = self._fit(last - first, self.term)[0]
        own = products_of(self.term, self.evidence)
        left = last - first - own.times(follows[:, None])[:, 0]
        return left, own.times((begin - end)[:, None])[:, 0]

    def _end(self, sign: int, room: float) -> float:
        """Signed distance to the end of the 95 % interval; all the room if it has none."""
        least, most = _LEAST * self._spread, room
        if most <= least or self._rise(sign * most) <= RISE:
            return sign * most
        for _ in range(_HALVINGS):
            middle = float(np.sqrt(least * most))
            told = self._rise(sign * middle) > RISE
            least, most = (least, middle) if told else (middle, most)
        return sign * most

    @property
    def _now(self) -> float:
        return float(getattr(self.term.effect, self.interval[0]))

    @property
    def _spread(self) -> float:
        """Standard deviation of a uniform distribution over the field's interval."""
        return (self.interval[2] - self.interval[1]) / 12**0.5

    @cached_property
    def _found(self) -> Array:
        return moved_by(self.term, self.evidence, self.scaled)

    def _rise(self, by: float) -> float:
        """Rise of chi square if the field is off by `by` and the values are fitted again."""
        return self._fit(self._found, self._at(by))[1]

    def _at(self, by: float) -> Candidate:
        """The cause with the field off by `by`, within the range tried."""
        value = float(np.clip(self._now + by, *self.within))
        field: dict[str, Any] = {self.interval[0]: value}
        effect: Effect = replace(cast(Any, self.term.effect), **field)
        return replace(self.term, effect=effect)

    def _fit(self, column: Array, cause: Candidate) -> tuple[Array, float]:
        """Fit a column (d n,) by a cause: its values (k,), and chi square of the remainder."""
        both = joined([products_of(cause, self.evidence), Plain(column[:, None])])
        known = self.evidence.information_of(both)
        own, across = known[:-1, :-1], known[:-1, -1]
        value = np.asarray(np.linalg.lstsq(own, across, rcond=_RANK)[0])
        return value, max(0.0, float(known[-1, -1] - across @ value)) / self.misfit


def _straight(rise: float) -> bool:
    """Whether chi square rises by about `RISE`, as it does along a straight line."""
    return RISE / _ALIKE <= rise <= RISE * _ALIKE
