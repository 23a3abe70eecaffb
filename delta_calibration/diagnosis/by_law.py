"""Laws of unknown structure replace maps in the extended model, beside named causes.

A map takes up whatever is smooth. A cause beside it that explains much less is not named, because
it may be a part of the structure. If a law explains the structure beside such a cause, and the
cause explains more than a map could beside the law, both are told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.constants import ANOTHER, IMPERFECT, LACKING, MOST
from delta_calibration.diagnosis.findings import HeldOutModels, of_term
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.law_grammar import COORDINATES
from delta_calibration.diagnosis.law_search import Likely, best_map, likely_laws, worth
from delta_calibration.diagnosis.law_words import fitted_with, told
from delta_calibration.diagnosis.name_checks import in_the_shadow, signal_of, untrusted
from delta_calibration.diagnosis.scan import scanned
from delta_calibration.diagnosis.search import SearchResult
from delta_calibration.diagnosis.verdict import Finding, FoundEquation
from delta_calibration.effects import Effect
from delta_calibration.errors import DataError

# the search, held-out errors of its model, and the finding of each of its terms
Confirmed = tuple[SearchResult, HeldOutModels, dict[Candidate, Finding]]
# applies all remaining checks to the causes beside a law; None if one of them fails
Check = Callable[[Confirmed], Confirmed | None]


@dataclass(frozen=True)
class ByLaw:
    """Laws of what has no name, likeliest first, and what holds beside the first."""

    confirmed: Confirmed
    laws: tuple[Likely, ...] = ()
    equations: tuple[FoundEquation, ...] = ()


def by_law(
    confirmed: Confirmed,
    lost: tuple[Candidate, ...],
    effects: Sequence[Effect],
    check: Check,
    rng: np.random.Generator,
) -> ByLaw:
    """Explain unknown structure by a law, beside the causes that hold or that were lost to a map.

    The latter only if no law holds without them, or if what then stands, the law or a map that
    predicts better, leaves more than noise.

    Args:
        confirmed: the causes that hold, and perhaps a map.
        lost: named causes of the search that do not hold beside the map.
        effects: effects that the machine may have.
        check: further checks of causes beside a law.
        rng: random generator of the bootstraps.
    """
    found, held, said = confirmed
    plain = without_maps(found.model)
    if not plain.placed or plain.evidence.axes != COORDINATES:
        return ByLaw(confirmed)
    laws = _laws(plain, effects, rng)
    alone = ByLaw(confirmed)
    try:
        if laws:
            alone = ByLaw(_in_place_of_maps(found, held, said, laws[0]), laws, told(laws, plain))
            if alone.confirmed[0].model.misfit <= LACKING:
                return alone
        return _beside(alone, found, lost, effects, check, rng) or alone
    except DataError:  # beside a cause or a law the fit does not reach all poses
        return alone


def _beside(
    alone: ByLaw,
    found: SearchResult,
    lost: tuple[Candidate, ...],
    effects: Sequence[Effect],
    check: Check,
    rng: np.random.Generator,
) -> ByLaw | None:
    """Laws beside causes that were lost; causes that do not hold there are left out in turn."""
    plain = without_maps(found.model)
    back = tuple(m for m in lost if not _from_maps(found.model, m))
    while back and len(plain.terms) + len(back) <= MOST:
        whole = plain.fitted((*plain.terms, *back))
        laws = _laws(whole, effects, rng)
        if not laws:
            return None
        model = fitted_with(whole, laws[0].guess).rested()
        both = replace(found, model=model, last=scanned(model, effects, rng))
        said = _said(both, len(whole.terms), effects, rng)
        if len(said) == len(whole.terms):
            checked = check((both, HeldOutModels(model), said))
            if checked is None or not _foretells(checked, alone.confirmed):
                return None
            return ByLaw(checked, laws, told(laws, whole))
        kept = tuple(m for m in back if any(m.same_cause(term) for term in said))
        if len(said) - len(kept) < len(plain.terms):  # one that holds without the law
            return None
        back = kept
    return None


def names_of(model: Fitted) -> tuple[Candidate, ...]:
    """Terms of a model that are no maps."""
    return tuple(term for term in model.terms if not term.unexplained)


def without_maps(model: Fitted) -> Fitted:
    """A model without its maps."""
    named = names_of(model)
    return model if named == model.terms else model.fitted(named)


def _laws(
    plain: Fitted, effects: Sequence[Effect], rng: np.random.Generator
) -> tuple[Likely, ...]:
    """Laws of the residuals of a model without maps."""
    return likely_laws(plain.beside, effects[0].robot, effects[0], rng)


def _in_place_of_maps(
    found: SearchResult, held: HeldOutModels, said: dict[Candidate, Finding], law: Likely
) -> Confirmed:
    """Replace maps by a law, if it predicts held-out data at least as well.

    Causes for which the law leaves nothing are removed.
    """
    model = fitted_with(without_maps(found.model), law.guess).rested()
    working = tuple(term for term in model.terms if model.scaled(term).any())
    if working != model.terms:
        model = model.fitted(working).rested()
    left = {m: f for m, f in said.items() if any(m.same_cause(term) for term in working)}
    now = replace(found, model=model), HeldOutModels(model), left
    return now if _foretells(now, (found, held, said)) else (found, held, said)


def _from_maps(model: Fitted, lost: Candidate) -> bool:
    """Whether a map of the model could make most of the signal of a cause that was lost to it."""
    both = model.fitted((*model.terms, lost))
    own, maps = both.terms[-1], [term for term in both.terms if term.unexplained]
    return not both.scaled(own).any() or any(in_the_shadow(both, own, m) for m in maps)


def _said(
    found: SearchResult, named: int, effects: Sequence[Effect], rng: np.random.Generator
) -> dict[Candidate, Finding]:
    """Findings of the first terms of a model, which have names, that hold beside a law.

    A law that is only nearly right leaves errors that a map would explain better than a name.
    """
    model, held, said = found.model, HeldOutModels(found.model), {}
    owed = IMPERFECT * sum(signal_of(model, part) for part in model.terms[named:])
    doubtful = untrusted(model)
    for term in model.terms[:named]:
        without = beside(model.evidence, tuple(m for m in model.terms if m is not term))
        if term in doubtful or signal_of(model, term) < max(ANOTHER, owed):
            continue
        if worth(without, [term]) <= best_map(without, effects[0], rng):
            continue
        finding = of_term(found, term, held, rng)
        if finding is not None:
            said[term] = finding
    return said


def _foretells(one: Confirmed, other: Confirmed) -> bool:
    """Whether a model predicts held-out poses no worse than another one."""
    now, then = (
        held.mm(held.terms(found.model.terms, held.sectors)) for found, held, _ in (one, other)
    )
    return now <= then
