"""Explanations weighed in any combination: what some of them explain together, and its price."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate, bounds_of, columns_of
from delta_calibration.diagnosis.constants import SHADOW
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import Chance, Score, decrease, log_bayes, most_likely

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointFit:
    """Explanations that are weighed in any combination: their columns' products."""

    candidates: tuple[Candidate, ...]
    tries: Array  # (c,)
    chances: tuple[Chance, ...]  # what each explains by chance
    information: Array  # (k, k)
    b: Array  # (k,)
    lower: Array  # (k,)
    upper: Array  # (k,)
    begin: tuple[int, ...]  # (c + 1,) where each candidate's columns begin

    @classmethod
    def of(cls, evidence: LinearizedModel, scores: Sequence[Score]) -> JointFit:
        """Of the candidates of these scores."""
        candidates = tuple(score.candidate for score in scores)
        columns = [columns_of(c, evidence) for c in candidates]
        every = np.concatenate(columns, axis=1)
        bounds = [bounds_of(c, evidence) for c in candidates]
        information = evidence.information(every)
        begin = tuple(np.cumsum([0, *(c.shape[1] for c in columns)]).tolist())
        own = [slice(*span) for span in pairwise(begin)]
        return cls(
            candidates=candidates,
            tries=np.array([score.tries for score in scores]),
            chances=tuple(Chance.of(information[span, span]) for span in own),
            information=information,
            b=(every.T @ evidence.weigh(evidence.column))[:, 0],
            lower=np.concatenate([low for low, _ in bounds]),
            upper=np.concatenate([high for _, high in bounds]),
            begin=begin,
        )

    def rows(self, terms: Sequence[int]) -> Array:
        """Columns of some of the candidates."""
        spans = [np.arange(self.begin[i], self.begin[i + 1]) for i in terms]
        return np.concatenate([np.zeros(0, dtype=np.int64), *spans]).astype(np.int64)

    def fit(self, terms: Sequence[int]) -> tuple[Array, float, float]:
        """Values, decrease of chi square and ln B of some together."""
        rows = self.rows(terms)
        if not rows.size:
            return np.zeros(0), 0.0, 0.0
        information, b = self.information[rows[:, None], rows], self.b[rows]
        value = most_likely(information, b, self.lower[rows], self.upper[rows])
        price = float(np.log(self.tries[list(terms)]).sum())
        log_b = log_bayes(information, b, value, sizes([self.candidates[i] for i in terms]))
        return value, decrease(information, b, value), log_b - price


def sizes(terms: Sequence[Candidate]) -> list[slice]:
    """Which of the terms' parameters, one after the other, share a size that is not known."""
    ends = np.cumsum([0, *(len(m.rows) for m in terms)]).tolist()
    spans = zip(terms, pairwise(ends), strict=True)
    return [slice(*span) for term, span in spans if term.sized]


def as_score(term: Candidate, tried: Sequence[Score]) -> Score:
    """A term to be weighed again, charged with what the search for its cause has cost."""
    tries = max((s.tries for s in tried if s.candidate.same_cause(term)), default=1.0)
    k = len(term.rows)
    return Score(term, np.zeros(k), np.zeros((k, k)), 0.0, 0.0, 0.0, tries)


def shadow(candidate: Candidate, gain: float) -> float:
    """What a map pays beyond its parameters: a tenth of what it explains."""
    return (1 - SHADOW) * gain / 2 if candidate.unexplained else 0.0
