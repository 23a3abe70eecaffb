"""Which explanations hold, alone and together.

Greedy search takes the best explanation, puts it beside the nuisance and looks again. Because two
effects can hide behind a third, the set is then improved by swaps, additions and removals among
the best shapes of everything that was tried, and every pair of them is tried as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import (
    Candidate,
    bounds_of,
    columns_of,
    dimensions,
    maps,
    subsets,
)
from delta_calibration.diagnosis.evidence import Evidence
from delta_calibration.diagnosis.scores import (
    Score,
    Weighed,
    decrease,
    log_bayes,
    most_likely,
)
from delta_calibration.effects import Effect

Array = NDArray[np.float64]

ALPHA = 0.002  # chance that a clean session raises any alarm
_MOST = 4  # effects at a time
_DRAWS = 64
_SHORT = 40  # explanations that swaps and pairs are made of
_IMPERFECT = 0.01  # share of what a model explains that it may get wrong itself
_SHADOW = 0.9  # of what a map explains that a named cause must explain to be preferred


@dataclass(frozen=True)
class Scan:
    """Everything tried on one evidence, best first."""

    scores: tuple[Score, ...]
    tests: int  # how many questions were asked

    def significant(self, score: Score) -> bool:
        """Whether chance would give this much once in 1/ALPHA sessions, of all that was asked."""
        return bool(score.log_p + np.log(self.tests) < np.log(ALPHA))

    def of_cause(self, candidate: Candidate) -> Score | None:
        """The best score of the same cause."""
        return next((s for s in self.scores if s.candidate.same_cause(candidate)), None)


def scan(
    evidence: Evidence,
    effects: Sequence[Effect],
    noise_degrees: float,
    rng: np.random.Generator,
    used: Sequence[Candidate] = (),
) -> Scan:
    """Score every explanation that is not used already."""
    weighed = Weighed.of(evidence, noise_degrees, _DRAWS, rng)
    questions = _questions(evidence, effects, used)
    scores = [score for shapes in questions for score in weighed.explore(shapes)]
    scores.sort(key=lambda score: -score.log_bayes)
    return Scan(tuple(scores), len(scores))


def _questions(
    evidence: Evidence, effects: Sequence[Effect], used: Sequence[Candidate]
) -> Iterator[list[list[Candidate]]]:
    """What to explore: for each effect its shapes, for each shape the whole and its parts."""
    for effect in effects:
        shapes = [shape for shape in effect.shapes(evidence.at) if not shape.missing(evidence.at)]
        groups = [
            [c for c in subsets(shape) if not any(_covers(other, c) for other in used)]
            for shape in shapes
        ]
        if groups and groups[0]:
            yield groups
    for candidate in (*dimensions(evidence), *maps(evidence, effects[0])):
        if not any(_covers(other, candidate) for other in used):
            yield [[candidate]]


def _covers(used: Candidate, candidate: Candidate) -> bool:
    """Whether all that the candidate could explain is in use."""
    if candidate.effect is None or used.effect is None:
        return used.effect is candidate.effect and used.rows == candidate.rows
    return used.same_cause(candidate) and set(candidate.rows) <= set(used.rows)


@dataclass(frozen=True)
class Together:
    """Explanations that are weighed in any combination: their columns' products."""

    candidates: tuple[Candidate, ...]
    tries: Array  # (c,)
    information: Array  # (k, k)
    b: Array  # (k,)
    lower: Array  # (k,)
    upper: Array  # (k,)
    begin: tuple[int, ...]  # (c + 1,) where each candidate's columns begin

    @classmethod
    def of(cls, evidence: Evidence, scores: Sequence[Score]) -> Together:
        """Of the candidates of these scores."""
        candidates = tuple(score.candidate for score in scores)
        columns = [columns_of(c, evidence) for c in candidates]
        every = np.concatenate(columns, axis=1)
        bounds = [bounds_of(c, evidence) for c in candidates]
        return cls(
            candidates=candidates,
            tries=np.array([score.tries for score in scores]),
            information=evidence.information(every),
            b=(every.T @ evidence.weigh(evidence.column))[:, 0],
            lower=np.concatenate([low for low, _ in bounds]),
            upper=np.concatenate([high for _, high in bounds]),
            begin=tuple(np.cumsum([0, *(c.shape[1] for c in columns)]).tolist()),
        )

    def rows(self, members: Sequence[int]) -> Array:
        """Columns of some of the candidates."""
        spans = [np.arange(self.begin[i], self.begin[i + 1]) for i in members]
        return np.concatenate([np.zeros(0, dtype=np.int64), *spans]).astype(np.int64)

    def fit(self, members: Sequence[int]) -> tuple[Array, float, float]:
        """Values, decrease of chi square and ln B of some together."""
        rows = self.rows(members)
        if not rows.size:
            return np.zeros(0), 0.0, 0.0
        information, b = self.information[np.ix_(rows, rows)], self.b[rows]
        value = most_likely(information, b, self.lower[rows], self.upper[rows])
        price = float(np.log(self.tries[list(members)]).sum())
        return value, decrease(information, b, value), log_bayes(information, b, value) - price
