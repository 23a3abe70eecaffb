"""How sure a name is: what else would explain the same, and how well.

The confidence in a cause and those of its class is their share of the probability among all that
was tried in their place, the other terms staying:

    P = 0.98 (1 - exp(-lambda / 25)) sum_s exp(ln B_s / c) / sum_a exp(ln B_a / c)

c being chi square per degree of freedom. The first two factors are for what was not tried. Some
causes that no catalogue has move the readings as one of it does: one in fifty. And a weak signal
of any origin has something of some cause in it: names need lambda of 80 to 160.

Two explanations are one class where the signal of the one, as found, lies within 18 degrees of
what the other can do (cos > 0.95), after all nuisance, and the other leaves no more unexplained
than chance might.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate, columns_of, moved_by
from delta_calibration.diagnosis.constants import KNOWN, NAMING, SAME, SEPARATED
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.joint_fit import JointFit, as_score
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import Score

Array = NDArray[np.float64]

_RANK = 1e-9
_NOTHING = ""


@dataclass(frozen=True)
class Rivalry:
    """A term among its rivals."""

    confidence: float
    equivalents: tuple[Candidate, ...]  # other causes of its class, nearest first
    signal: float  # lambda: squared length of its signal after nuisance


def standing(model: Fitted, term: Candidate, tried: Sequence[Score]) -> Rivalry:
    """How a term stands against everything that was tried in its place."""
    rest = tuple(m for m in model.terms if m is not term)
    evidence = beside(model.evidence, rest)
    signal = moved_by(term, evidence, model.scaled(term))
    others = [s for s in tried if not s.candidate.same_cause(term)]
    others = [s for s in others if not any(_within(s.candidate, m) for m in rest)]
    length = float(signal @ evidence.weigh(signal[:, None])[:, 0])
    same = equivalents(evidence, signal, others, max(1.0, model.misfit))
    causes = {term.cause, *(candidate.cause for candidate in same)}
    return Rivalry(
        confidence=named(length) * _confidence(model, rest, others, tried, term, causes),
        equivalents=same,
        signal=length,
    )


def _within(candidate: Candidate, term: Candidate) -> bool:
    """Whether a term explains all that a candidate of the same cause could.

    One joint's lag beside a late clock does not: lags of all joints may be what both are.
    """
    return candidate.same_cause(term) and set(candidate.rows) <= set(term.rows)


def named(signal: float) -> float:
    """How far a signal of this lambda is enough for a name."""
    return KNOWN * float(1 - np.exp(-signal / NAMING))


def equivalents(
    evidence: LinearizedModel, signal: Array, others: Sequence[Score], misfit: float = 1.0
) -> tuple[Candidate, ...]:
    """The candidates that can do what the signal (d n,) does, one a cause, nearest first."""
    weighed = evidence.weigh(signal[:, None])[:, 0]
    length = float(signal @ weighed)
    near: dict[str, tuple[float, Candidate]] = {}
    for candidate in (score.candidate for score in others):
        if candidate.unexplained:
            continue
        columns = columns_of(candidate, evidence)
        share = reached(evidence.information(columns), columns.T @ weighed) / length
        if share < SAME**2 or (1 - share) * length > SEPARATED * misfit:
            continue
        if share > near.get(candidate.cause, (0.0, candidate))[0]:
            near[candidate.cause] = share, candidate
    return tuple(c for _, c in sorted(near.values(), key=lambda pair: -pair[0]))


def reached(information: Array, along: Array) -> float:
    """Squared length of the projection on columns of this information."""
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
    """Share of the probability that falls to the term's class of causes."""
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
