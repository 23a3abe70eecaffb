"""Causes that must or may have another name beside the others that were found.

Two effects may have the same signal only in a machine that has a third one as well: friction
leaves a joint behind as play does if its drive yields. Then the effect itself says what else it
may be, or must be (`Effect.same_signal_beside`, `Effect.must_be`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.verdict import Finding

Array = NDArray[np.float64]

Said = Mapping[Candidate, Finding]

_SURE = 2.0  # standard deviations


def renamed(said: Said, at: Conditions) -> tuple[Candidate, ...]:
    """The causes found; one that is impossible beside another has the name that it must have.

    Args:
        said: the finding of each.
        at: conditions of the poses at rest.
    """
    effects = [term for term in said if term.effect is not None]

    def name(term: Candidate) -> Candidate:
        for other in effects:
            if term.effect is None or other.effect is None or other is term:
                continue
            most, _ = _bounds(term, said[term])
            _, least = _bounds(other, said[other])
            instead = term.effect.must_be(most, other.effect, least, at)
            if instead is not None:
                return replace(term, cause=instead.cause, kind=instead.kind, effect=instead)
        return term

    every = tuple(name(term) for term in said)
    causes = [term.cause for term in every]
    new = [term.cause for term, old in zip(every, said, strict=True) if term is not old]
    return tuple(said) if any(causes.count(cause) > 1 for cause in new) else every


def told_again(old: Finding, new: Finding) -> Finding:
    """The finding of a cause after a fit with others renamed, or this one.

    It is no surer than before. The former name is impossible, and no equivalent.
    """
    sure = min(old.confidence, new.confidence)
    if new.cause == old.cause:
        return replace(new, confidence=sure)
    others = tuple(cause for cause in new.equivalents if cause != old.cause)
    apart = new.separated_by if others else None
    return replace(new, confidence=sure, equivalents=others, separated_by=apart)


def with_same_signal(said: Said) -> dict[Candidate, Finding]:
    """The findings, with those causes as equivalents that do the same beside another one found.

    Only at joints where the other one surely acts, and if the equivalent is not found there too.
    """

    def told(term: Candidate, finding: Finding) -> Finding:
        for other in said:
            if term.effect is None or other.effect is None:
                continue
            same = term.effect.same_signal_beside(other.effect)
            if same is None or not _places(term, finding) & _places(other, said[other]):
                continue
            cause, apart = same
            found = (_places(m, f) for m, f in said.items() if m.cause == cause)
            if any(_places(term, finding) & places for places in found):
                continue
            equivalents = tuple(dict.fromkeys((*finding.equivalents, cause)))
            return replace(finding, equivalents=equivalents, separated_by=apart)
        return finding

    return {term: told(term, finding) for term, finding in said.items()}


def _bounds(term: Candidate, finding: Finding) -> tuple[Array, Array]:
    """Upper and lower bounds of a cause's values, (k,) each; 0 where it may not act."""
    assert term.effect is not None
    most, least = np.zeros((2, len(term.effect.parameters)))
    for i, name in enumerate(term.effect.parameters.names):
        found = finding.parameters.get(name)
        if found is not None and found.value > (off := _SURE * (found.std or 0.0)):
            most[i], least[i] = found.value + off, found.value - off
    return most, least


def _places(term: Candidate, finding: Finding) -> set[str | None]:
    """Joints at which a cause surely acts."""
    if term.effect is None:
        return set()
    most, _ = _bounds(term, finding)
    return {p.location for p, value in zip(term.effect.parameters, most, strict=True) if value}
