"""A plain search by the Bayesian information criterion over the catalogue, for comparison.

Forward selection with backward steps among all effects in all their shapes and all dimensions,

    BIC = chi square + k ln n,

with k the values and searched fields of the chosen terms and n the number of measured coordinates
(Schwarz 1978, Annals of Statistics 6, 461-464). Geometry, frame and noise are those of the
diagnosis; what this search lacks is what the diagnosis adds: sizes that machines have, maps, held-
out data, classes of indistinguishable causes and tests of the residuals.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from delta_calibration.diagnosis.candidates import (
    Candidate,
    all_columns,
    bounds_of,
    dimensions,
    subsets,
)
from delta_calibration.diagnosis.constants import MOST
from delta_calibration.diagnosis.fitted import beside, gains_of
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import decrease, most_likely
from delta_calibration.diagnosis.shapes import Shapes
from delta_calibration.effects import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Chosen:
    """A chosen term and its weight against the best choice without its cause."""

    candidate: Candidate
    weight: float


def chosen(evidence: LinearizedModel, effects: Sequence[Effect]) -> tuple[Chosen, ...]:
    """Terms with the least BIC, each with its BIC weight.

    Args:
        evidence: residuals of the calibrated machine.
        effects: the catalogue.
    """
    every = candidates(evidence, effects)
    terms: tuple[Candidate, ...] = ()
    while len(terms) < MOST:
        gain, best = _next(evidence, terms, every)
        if best is None or gain <= 0:
            break
        terms = _without_the_useless(evidence, (*terms, best))
        if best not in terms:
            break
    return tuple(Chosen(term, _weight(evidence, terms, term, every)) for term in terms)


def candidates(
    evidence: LinearizedModel, effects: Sequence[Effect], most: int | None = None
) -> list[Candidate]:
    """All effects in all their shapes, whole and of each joint, and all dimensions.

    Args:
        evidence: residuals of the calibrated machine.
        effects: the catalogue.
        most: number of shapes of each effect; all if not given.
    """
    every = (*_of_effects(evidence, effects, most), *dimensions(evidence))
    return sorted(every, key=lambda c: len(c.rows))


def gains(
    evidence: LinearizedModel, terms: Sequence[Candidate], every: Sequence[Candidate]
) -> Array:
    """Decrease of chi square by each candidate beside some terms, (c,)."""
    return gains_of(Shapes.of(beside(evidence, terms)), every)


def _of_effects(
    evidence: LinearizedModel, effects: Sequence[Effect], most: int | None
) -> Iterator[Candidate]:
    for effect in effects:
        shapes = [s for s in effect.shapes(evidence.at) if not s.missing(evidence.at)]
        for shape in shapes[:: max(1, -(-len(shapes) // (most or len(shapes) or 1)))]:
            yield from (c for c in subsets(shape) if c.sought)


def _next(
    evidence: LinearizedModel, terms: tuple[Candidate, ...], every: Sequence[Candidate]
) -> tuple[float, Candidate | None]:
    """The candidate of another cause that lowers BIC most, and by how much."""
    others = [c for c in every if not any(c.same_cause(term) for term in terms)]
    if not others:
        return 0.0, None
    worth = gains(evidence, terms, others) - np.array([_price(evidence, c) for c in others])
    best = int(np.argmax(worth))
    return float(worth[best]), others[best]


def _price(evidence: LinearizedModel, candidate: Candidate) -> float:
    """k ln n of a candidate."""
    fields = 0 if candidate.effect is None else len(candidate.effect.bounded_intervals())
    return (len(candidate.rows) + fields) * float(np.log(evidence.size))


def _bic(evidence: LinearizedModel, terms: Sequence[Candidate]) -> float:
    """BIC of some terms less that of none, with values within their bounds."""
    if not terms:
        return 0.0
    columns = all_columns(terms, evidence)
    information = evidence.information_of(columns)
    along = columns.along(evidence.weigh(evidence.column))[:, 0]
    lower, upper = (np.concatenate(ends) for ends in zip(*map(bounds_of, terms), strict=True))
    value = most_likely(information, along, lower, upper)
    return sum(_price(evidence, term) for term in terms) - decrease(information, along, value)


def _without_the_useless(
    evidence: LinearizedModel, terms: tuple[Candidate, ...]
) -> tuple[Candidate, ...]:
    """The terms without those whose removal lowers BIC, one after the other."""
    while terms:
        now = _bic(evidence, terms)
        fewer = [tuple(t for t in terms if t is not term) for term in terms]
        least = min(fewer, key=lambda some: _bic(evidence, some))
        if _bic(evidence, least) >= now:
            break
        terms = least
    return terms


def _weight(
    evidence: LinearizedModel,
    terms: tuple[Candidate, ...],
    term: Candidate,
    every: Sequence[Candidate],
) -> float:
    """BIC weight of a term against the best choice without its cause."""
    kept = tuple(t for t in terms if t is not term)
    others = [c for c in every if not c.same_cause(term)]
    gain, _ = _next(evidence, kept, others)
    without = _bic(evidence, kept) - max(gain, 0.0)
    return float(expit((without - _bic(evidence, terms)) / 2))
