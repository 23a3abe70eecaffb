"""Causes that may have another name beside the others that were found.

Two effects may have the same signal only in a machine that has a third one as well: friction
leaves a joint behind as play does if its drive yields. Then the effect itself says so
(`Effect.same_signal_beside`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.verdict import Finding

Array = NDArray[np.float64]

Said = Mapping[Candidate, Finding]

_SURE = 2.0  # standard deviations


def with_same_signal(said: Said, evidence: LinearizedModel) -> dict[Candidate, Finding]:
    """The findings, with those causes as equivalents that do the same beside another one found.

    Only at joints where the other one surely acts, and if the equivalent is not found there too.
    """
    at, told = evidence.at.take(np.arange(evidence.poses)), dict(said)
    for term, finding in said.items():
        for cause, apart in filter(None, (_alike(said, term, other, at) for other in said)):
            equivalents = tuple(dict.fromkeys((*finding.equivalents, cause)))
            told[term] = replace(finding, equivalents=equivalents, separated_by=apart)
    return told


def _alike(
    said: Said, term: Candidate, other: Candidate, at: Conditions
) -> tuple[str, str] | None:
    """Name of the cause that a term looks like beside another one, and what separates the two."""
    own = _places(said, term)
    if term.effect is None or other.effect is None or not own & _places(said, other):
        return None
    (most, _), (_, least) = _bounds(term, said[term]), _bounds(other, said[other])
    alike = term.effect.same_signal_beside(most, other.effect, least, at)
    if alike is None:
        return None
    there = (_places(said, m) for m in said if m.cause == alike[0])
    return None if any(own & places for places in there) else alike


def _bounds(term: Candidate, finding: Finding) -> tuple[Array, Array]:
    """Upper and lower bounds of a cause's values, (k,) each; 0 where it may not act."""
    assert term.effect is not None
    most, least = np.zeros((2, len(term.effect.parameters)))
    for i, name in enumerate(term.effect.parameters.names):
        found = finding.parameters.get(name)
        if found is not None and found.value > (off := _SURE * (found.std or 0.0)):
            most[i], least[i] = found.value + off, found.value - off
    return most, least


def _places(said: Said, term: Candidate) -> set[str | None]:
    """Joints at which a cause surely acts; none if it is a dimension."""
    if term.effect is None:
        return set()
    most, _ = _bounds(term, said[term])
    return {p.location for p, value in zip(term.effect.parameters, most, strict=True) if value}
