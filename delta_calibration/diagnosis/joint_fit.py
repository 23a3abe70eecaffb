"""Joint fits of candidates in any combination: decrease of chi square and Bayes factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import log

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from delta_calibration.diagnosis.candidates import (
    Candidate,
    all_columns,
    bounds_of,
    products_of,
)
from delta_calibration.diagnosis.constants import SHADOW
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import (
    PRECISION,
    Chance,
    Score,
    change,
    log_bayes,
    most_likely,
    tries_of,
)
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class _Maps:
    """Smooth maps eliminated from a joint fit: L L' = G + P, with G and P of their values."""

    factor: Array  # (u, u) L
    along: Array  # (u,) L^-1 b
    across: Array  # (u, named) L^-1 G with the columns of all that are no maps

    @cached_property
    def log_bayes(self) -> float:
        """ln B of the maps by themselves."""
        price = np.log(np.diag(self.factor)).sum() - len(self.along) * log(PRECISION) / 2
        return float(self.along @ self.along / 2 - price)

    def gain(self, others: Array) -> float:
        """Decrease of chi square by the maps beside other columns; others: `across` v, (u,)."""
        value = _rooted(self.factor, self.along - others, trans=1)
        return float(self.along @ self.along + PRECISION * value @ value)


@dataclass(frozen=True)
class JointFit:
    """Inner products of the columns of some candidates, to fit them in any combination.

    The values of maps have known sizes and no bounds. They are eliminated like the nuisance
    parameters: this changes the products of the other columns, whose ln B is then added to that of
    the maps. The elimination of the same maps is computed once.
    """

    candidates: tuple[Candidate, ...]
    tries: Array  # (c,) independent tries of each one's search
    information: Array  # (k, k)
    b: Array  # (k,)
    lower: Array  # (k,)
    upper: Array  # (k,)
    begin: tuple[int, ...]  # (c + 1,) index of the first column of each candidate
    known: dict[tuple[int, ...], _Maps] = field(default_factory=dict)  # by indices of maps

    @classmethod
    def of(cls, evidence: LinearizedModel, scores: Sequence[Score]) -> JointFit:
        """Joint fit of the candidates of these scores."""
        every = all_columns([score.candidate for score in scores], evidence)
        b = every.along(evidence.weigh(evidence.column))[:, 0]
        return cls._with(scores, evidence.information_of(every), b)

    @classmethod
    def one_beside(
        cls, evidence: LinearizedModel, kept: Sequence[Score], others: Sequence[Score]
    ) -> JointFit:
        """Joint fit of the candidates that are kept, together with any single one of the others.

        Products between two of the others are not computed, because there are many.
        """
        scores, weighed = [*kept, *others], evidence.weigh(evidence.column)
        begin = _begin_of(scores)
        first, own = slice(0, begin[len(kept)]), [slice(*span) for span in pairwise(begin)]
        always = all_columns([score.candidate for score in kept], evidence)
        taken = evidence.taken_of(always)
        information, b = np.zeros((begin[-1], begin[-1])), np.zeros(begin[-1])
        information[first, first] = always.inner() - taken.T @ taken
        b[first] = always.along(weighed)[:, 0]
        for score, span in zip(others, own[len(kept) :], strict=True):
            columns = products_of(score.candidate, evidence)
            of_own = evidence.taken_of(columns)
            information[span, span] = columns.inner() - of_own.T @ of_own
            information[first, span] = always.across(columns) - taken.T @ of_own
            information[span, first] = information[first, span].T
            b[span] = columns.along(weighed)[:, 0]
        return cls._with(scores, information, b)

    @classmethod
    def _with(cls, scores: Sequence[Score], information: Array, b: Array) -> JointFit:
        candidates = tuple(score.candidate for score in scores)
        bounds = [bounds_of(candidate) for candidate in candidates]
        return cls(
            candidates=candidates,
            tries=np.array([score.tries for score in scores]),
            information=information,
            b=b,
            lower=np.concatenate([low for low, _ in bounds]),
            upper=np.concatenate([high for _, high in bounds]),
            begin=_begin_of(scores),
        )

    def chance(self, i: int) -> Chance:
        """Distribution of the decrease of chi square that a candidate gives by chance."""
        span = slice(*self.begin[i : i + 2])
        return Chance.of(self.information[span, span])

    def rows(self, terms: Sequence[int]) -> Index:
        """Indices of the columns of some of the candidates."""
        spans = [np.arange(self.begin[i], self.begin[i + 1]) for i in terms]
        return np.concatenate([np.zeros(0, dtype=np.int64), *spans]).astype(np.int64)

    def fit(self, terms: Sequence[int]) -> tuple[float, float]:
        """Decrease of chi square and ln B of some candidates together."""
        named = [i for i in terms if not self.candidates[i].unexplained]
        maps = self._maps(tuple(sorted(i for i in terms if i not in named)))
        rows = self.rows(named)
        across = maps.across[:, np.searchsorted(self._named, rows)]
        information = self.information[rows[:, None], rows] - across.T @ across
        b = self.b[rows] - across.T @ maps.along
        value = most_likely(information, b, self.lower[rows], self.upper[rows])
        gain = maps.gain(across @ value) + change(information, b, value)
        log_b = maps.log_bayes + log_bayes(
            information, b, value, sizes([self.candidates[i] for i in named])
        )
        choices = self.tries[list(terms)] * [self.candidates[i].choices for i in terms]
        return max(0.0, gain), log_b - float(np.log(choices).sum())

    def _maps(self, maps: tuple[int, ...]) -> _Maps:
        """The elimination of these maps, computed on first use."""
        if maps not in self.known:
            rows = self.rows(maps)
            own = self.information[rows[:, None], rows] + PRECISION * np.eye(len(rows))
            others = np.column_stack([self.b[rows], self.information[rows[:, None], self._named]])
            factor = np.asarray(np.linalg.cholesky(own), dtype=np.float64)
            left = _rooted(factor, others)
            self.known[maps] = _Maps(factor, left[:, 0], left[:, 1:])
        return self.known[maps]

    @cached_property
    def _named(self) -> Index:
        """Indices of the columns of all candidates that are no maps."""
        every = enumerate(self.candidates)
        return self.rows([i for i, candidate in every if not candidate.unexplained])


def _begin_of(scores: Sequence[Score]) -> tuple[int, ...]:
    """Index of the first column of each candidate, then the number of columns."""
    return tuple(np.cumsum([0, *(len(score.candidate.rows) for score in scores)]).tolist())


def _rooted(factor: Array, right: Array, trans: int = 0) -> Array:
    """L^-1 (trans=0) or L'^-1 (trans=1) times columns (u, j); they may be none."""
    if not right.size:
        return right
    found = solve_triangular(factor, right, lower=True, trans=trans, check_finite=False)
    return np.asarray(found)


def sizes(terms: Sequence[Candidate]) -> list[slice]:
    """Slices of the terms' concatenated parameters that share an unknown size, one a term."""
    ends = np.cumsum([0, *(len(m.rows) for m in terms)]).tolist()
    spans = zip(terms, pairwise(ends), strict=True)
    return [slice(*span) for term, span in spans if term.sized]


def as_score(term: Candidate, tried: Sequence[Score]) -> Score:
    """Score of a term that is to be evaluated again, with the tries of its cause's search."""
    k = len(term.rows)
    nothing = np.broadcast_to(0.0, (k, k))
    return Score(term, np.zeros(k), nothing, np.ones(k), 0.0, 0.0, tries_of(term, tried), np.inf)


def shadow(candidate: Candidate, gain: float) -> float:
    """Penalty on ln B of a map beyond its parameters: a tenth of the D / 2 it explains."""
    return (1 - SHADOW) * gain / 2 if candidate.unexplained else 0.0
