"""Checks of a named cause: it may only be a part of structure that nothing explains."""

from __future__ import annotations

import numpy as np

from delta_calibration.diagnosis.candidates import Candidate, moved_by, products_of
from delta_calibration.diagnosis.constants import CLEAR, REMAINS, SHADOWED
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.rivals import reached


def untrusted(model: Fitted) -> tuple[Candidate, ...]:
    """Terms whose names cannot be trusted.

    If much structure remains that nothing or only a smooth map explains, a cause that explains
    less than a quarter as much may be a part of it under a wrong name. If the model needs a map or
    a free curve, a cause that explains less than this, and whose signal this could reproduce, is
    taken for a part of it.
    """
    maps = [m for m in model.terms if m.unexplained]
    free = [m for m in model.terms if m.effect is not None and m.effect.free_form]
    remains = unexplained(model) + sum(signal_of(model, m) for m in maps)
    return tuple(
        term
        for term in model.terms
        if not term.unexplained
        and (
            signal_of(model, term) < REMAINS * remains
            or any(in_the_shadow(model, term, other) for other in free if other is not term)
        )
    )


def unexplained(model: Fitted) -> float:
    """Chi square beyond the noise, at rest and in motion; each counts only if significant."""
    evidence = model.beside
    left, counted = evidence.left(), evidence.counted
    resting = np.arange(len(evidence)) < evidence.poses
    share = evidence.degrees / counted.sum()
    total = 0.0
    for rows, known in ((resting, model.noise_degrees), (~resting, np.inf)):
        rows = rows & (counted > 0)
        degrees = share * float(counted[rows].sum())
        excess = float(np.sum(left[rows] ** 2)) - degrees
        spread = np.sqrt(2 * degrees + 2 * degrees**2 / known)
        total += excess if excess > CLEAR * spread else 0.0
    return total


def signal_of(model: Fitted, term: Candidate) -> float:
    """lambda of a term: squared length of its signal, with the other terms as nuisance."""
    evidence = beside(model.evidence, tuple(m for m in model.terms if m is not term))
    signal = moved_by(term, evidence, model.scaled(term))
    return float(signal @ evidence.weigh(signal[:, None])[:, 0])


def in_the_shadow(model: Fitted, term: Candidate, other: Candidate) -> bool:
    """Whether a free form or a map explains more than a term and could make most of its signal."""
    rest = tuple(m for m in model.terms if m is not term and m is not other)
    evidence = beside(model.evidence, rest)
    signal = moved_by(term, evidence, model.scaled(term))
    weighed = evidence.weigh(signal[:, None])
    columns = products_of(other, evidence)
    drawn = reached(evidence.information_of(columns), columns.along(weighed)[:, 0])
    less = signal_of(model, term) < signal_of(model, other)
    return less and drawn > SHADOWED * float(signal @ weighed[:, 0])
