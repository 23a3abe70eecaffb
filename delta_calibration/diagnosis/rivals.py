"""Confidence in the name of a cause, from how well its rivals explain the same signal.

The confidence in a class of causes is its share of the probability among all candidates that were
tried in its place, with the other terms kept, and of none of them:

    P = 0.98 (1 - exp(-lambda / 12)) sum_s exp(ln B_s / c) / sum_a exp(ln B_a / c)

c is chi square per degree of freedom, at least 1; s are the causes of the class, a all causes,
each by its best candidate, and no cause. The first two factors allow for causes that were not
tried: those of no catalogue, and a weak signal of any origin, which resembles some cause in part.

Two explanations are one class if, after all nuisance, the signal of the one, as found, lies within
18 degrees of the span of the other's columns (cos > 0.95), and the other leaves no more of it
unexplained than chance might.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate, columns_of, moved_by
from delta_calibration.diagnosis.constants import KINDRED, KNOWN, NAMING, SAME, SEPARATED
from delta_calibration.diagnosis.fitted import Fitted, beside, in_best_shape
from delta_calibration.diagnosis.joint_fit import JointFit, as_score
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import Score

Array = NDArray[np.float64]

_RANK = 1e-9
_NOTHING = ""


@dataclass(frozen=True)
class Rivalry:
    """Confidence in a term, the causes equivalent to it, and its signal."""

    confidence: float
    equivalents: tuple[Candidate, ...]  # other causes of its class, nearest first
    signal: float  # lambda: squared length of its signal after nuisance


def standing(model: Fitted, term: Candidate, tried: Sequence[Score]) -> Rivalry:
    """Compare a term with every candidate that was tried in its place."""
    rest = tuple(m for m in model.terms if m is not term)
    evidence = beside(model.evidence, rest)
    signal = moved_by(term, evidence, model.scaled(term))
    others = [s for s in tried if not s.candidate.same_name(term)]
    # if a term is the lag of one joint, the lags of all joints are a rival of the other terms: a
    # late clock and the lag of one joint together can be the lags of all
    others = [s for s in others if not any(m.contains(s.candidate) for m in rest)]
    near = in_its_place(evidence, signal, others)
    others = [score for _, score in near]
    length = float(signal @ evidence.weigh(signal[:, None])[:, 0])
    same = _nearest(length, near, max(1.0, model.misfit))
    causes = {term.cause, *(candidate.cause for candidate in same)}
    return Rivalry(
        confidence=named(length) * _confidence(model, rest, others, tried, term, causes),
        equivalents=same,
        signal=length,
    )


def in_its_place(
    evidence: LinearizedModel, signal: Array, others: Sequence[Score], below: float = np.inf
) -> list[tuple[float, Score]]:
    """Scores of others in the place of a cause, each with the share of its signal that they make.

    One that makes most of it is taken in its best shape: a strong signal determines moments and
    time constants between the points of the search.

    Args:
        evidence: beside the other terms.
        signal: of the cause, (d n,).
        others: scores of other causes.
        below: share of the signal from which a cause keeps its shape.
    """
    near = []
    for share, score in _shares(evidence, signal, others):
        if KINDRED < share < below:
            score = replace(score, candidate=in_best_shape(evidence, score.candidate))
            near += _shares(evidence, signal, [score])
        else:
            near.append((share, score))
    return near


def named(signal: float) -> float:
    """Largest confidence in a name that a signal of this lambda allows."""
    return KNOWN * float(1 - np.exp(-signal / NAMING))


def equivalents(
    evidence: LinearizedModel, signal: Array, others: Sequence[Score], misfit: float = 1.0
) -> tuple[Candidate, ...]:
    """Candidates that can reproduce the signal (d n,), the best of each cause, nearest first."""
    length = float(signal @ evidence.weigh(signal[:, None])[:, 0])
    return _nearest(length, _shares(evidence, signal, others), misfit)


def _nearest(
    length: float, others: Sequence[tuple[float, Score]], misfit: float
) -> tuple[Candidate, ...]:
    """Of others and the shares that they make of a signal, those that can reproduce it."""
    near: dict[str, tuple[float, Candidate]] = {}
    for share, score in others:
        candidate = score.candidate
        if share < SAME**2 or (1 - share) * length > SEPARATED * misfit:
            continue
        if share > near.get(candidate.cause, (0.0, candidate))[0]:
            near[candidate.cause] = share, candidate
    return tuple(c for _, c in sorted(near.values(), key=lambda pair: -pair[0]))


def _shares(
    evidence: LinearizedModel, signal: Array, others: Sequence[Score]
) -> list[tuple[float, Score]]:
    """Scores of others, each with the share of a signal (d n,) that it makes; 0 for maps."""
    weighed = evidence.weigh(signal[:, None])[:, 0]
    length = float(signal @ weighed)
    known: dict[int, tuple[Array, Array]] = {}  # products of all values of an effect

    def products(candidate: Candidate) -> tuple[Array, Array]:
        columns = columns_of(candidate, evidence)
        return evidence.information(columns), columns.T @ weighed

    def squared(candidate: Candidate) -> float:
        if candidate.unexplained or not length > 0:
            return 0.0
        if candidate.effect is None:
            return reached(*products(candidate))
        one, own = id(candidate.effect), list(candidate.rows)
        if one not in known:
            known[one] = products(candidate.with_all_values)
        information, along = known[one]
        return reached(information[np.ix_(own, own)], along[own])

    return [(squared(score.candidate) / max(length, 1e-300), score) for score in others]


def reached(information: Array, along: Array) -> float:
    """Squared projection of a signal onto columns, from their products `along` with it."""
    values, axes = np.linalg.eigh(information)
    shown = values > _RANK * max(float(values[-1]), 1e-300)
    return float(np.sum((axes[:, shown].T @ along) ** 2 / values[shown]))


def _confidence(
    model: Fitted,
    rest: tuple[Candidate, ...],
    others: Sequence[Score],
    tried: Sequence[Score],
    term: Candidate,
    causes: set[str],
) -> float:
    """Share of the term's class of causes in the probability of all candidates."""
    always = [as_score(m, tried) for m in rest]
    one = [as_score(term, tried), *others]
    together = JointFit.one_beside(model.evidence, always, one)
    kept = tuple(range(len(always)))
    best = {_NOTHING: together.fit(kept)[1]}
    for i, candidate in enumerate(together.candidates):
        if i not in kept:
            name = candidate.label if candidate.unexplained else candidate.cause
            best[name] = max(best.get(name, -np.inf), together.fit((i, *kept))[1])
    own = {term.label} if term.unexplained else causes
    worth = np.array(list(best.values())) / max(1.0, model.misfit)
    share = np.exp(worth - worth.max())
    among = np.array([name in own for name in best])
    return float(share[among].sum() / share.sum())
