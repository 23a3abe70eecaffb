"""What a session cannot tell: causes that hide behind others, or that nothing in it would show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from delta_calibration.diagnosis.experiments import next_experiment, visibility
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate, columns_of, dimensions, subsets
from delta_calibration.diagnosis.evidence import Evidence
from delta_calibration.diagnosis.geometry import without_geometry
from delta_calibration.diagnosis.verdict import CannotTell, Finding
from delta_calibration.effects import Effect

Array = NDArray[np.float64]

_SHOWS = 80.0  # lambda from which a cause is named
_HIDDEN = 20.0  # lambda under which it is not even seen


def unseen(
    evidence: Evidence, effects: Sequence[Effect], findings: Sequence[Finding]
) -> tuple[CannotTell, ...]:
    """Classes among the findings, and effects that this session would not show.

    Args:
        evidence: beside everything found.
        effects: the catalogue.
        findings: what was found.
    """
    said = [_of_class(finding) for finding in findings if finding.equivalents]
    found = {finding.cause for finding in findings}
    reasons: dict[tuple[str, str], list[str]] = {}
    for effect in effects:
        if effect.cause in found:
            continue
        blind = _blind(evidence, effect)
        if blind is not None:
            partner, because, following = blind
            names = reasons.setdefault((because, following), [])
            names += [n for n in (effect.cause, partner) if n and n not in names]
    said += [
        CannotTell(tuple(names) if len(names) > 1 else (*names, _NOTHING), because, following)
        for (because, following), names in reasons.items()
    ]
    return tuple(said)


_NOTHING = "no error at all"


def _of_class(finding: Finding) -> CannotTell:
    return CannotTell(
        (finding.cause, *finding.equivalents),
        "they move the readings of this session alike",
        finding.separated_by or "",
    )


def _blind(evidence: Evidence, effect: Effect) -> tuple[str, str, str] | None:
    """Partner, reason and next experiment of an effect of typical size that would not show."""
    shape = next(effect.shapes(evidence.at), effect)
    lacking = shape.missing(evidence.at)
    candidate = next(subsets(shape))
    if lacking:
        return "", lacking, f"record it: {' and '.join(shape.needs)}"
    bare, beside = visibility(evidence, shape)
    if beside >= _HIDDEN:
        return None
    following = next_experiment(evidence, candidate, None)
    if bare < _SHOWS:
        return "", _absent(evidence, shape), following
    because = "the geometry can take its place on these poses"
    return _partner(evidence, candidate), because, following


def _absent(evidence: Evidence, effect: Effect) -> str:
    """Why nothing of an effect shows."""
    at = evidence.at
    if not (at.velocity != 0).any():
        return "nothing was measured in motion"
    return "a typical one stays under the noise of this session"


def _partner(evidence: Evidence, candidate: Candidate) -> str:
    """The cause whose dimensions come nearest to the signal of a typical size."""
    bare = without_geometry(evidence)
    signal = columns_of(candidate, evidence) @ np.ones(len(candidate.rows))
    weighed = bare.weigh(signal[:, None])[:, 0]
    causes: dict[str, list[int]] = {}
    for dimension in dimensions(evidence):
        causes.setdefault(dimension.cause, []).extend(dimension.rows)
    reached = {}
    for cause, rows in causes.items():
        columns = evidence.geometry[:, rows]
        along = columns.T @ weighed
        normal = bare.information(columns) + np.eye(len(rows))
        reached[cause] = float(along @ np.linalg.solve(normal, along))
    return max(reached, key=lambda cause: reached[cause])
