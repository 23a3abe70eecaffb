"""Laws of unknown structure take the place of maps in the extended model, beside named causes.

A map takes up whatever is smooth. A cause beside it that explains much less is not named, because
it may be a part of the structure. If a law explains the structure beside such a cause, and the
cause explains more than the law's own error, both are right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.constants import IMPERFECT, LACKING
from delta_calibration.diagnosis.findings import HeldOutModels, of_term
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.law_search import Likely, likely_laws
from delta_calibration.diagnosis.law_words import fitted_with, told
from delta_calibration.diagnosis.name_checks import in_the_shadow, signal_of, untrusted
from delta_calibration.diagnosis.search import SearchResult
from delta_calibration.diagnosis.verdict import Finding, FoundEquation
from delta_calibration.effects import Effect

# the search, held-out errors of its model, and the finding of each of its terms
Confirmed = tuple[SearchResult, HeldOutModels, dict[Candidate, Finding]]


@dataclass(frozen=True)
class ByLaw:
    """Laws of what has no name, likeliest first, and what holds beside the first."""

    confirmed: Confirmed
    laws: tuple[Likely, ...] = ()
    equations: tuple[FoundEquation, ...] = ()


def by_law(
    confirmed: Confirmed, lost: tuple[Candidate, ...], effect: Effect, rng: np.random.Generator
) -> ByLaw:
    """Explain unknown structure by a law, beside the causes that hold or that were lost to a map.

    Args:
        confirmed: the causes that hold, and perhaps a map.
        lost: named causes of the search that do not hold beside the map.
        effect: any effect on the machine.
        rng: random generator of the bootstraps.
    """
    found, held, said = confirmed
    plain = without_maps(found.model)
    laws = _laws(plain, effect, rng)
    alone = ByLaw(confirmed)
    if laws:
        alone = ByLaw(_in_place_of_maps(found, held, said, laws[0]), laws, told(laws, plain))
        if alone.confirmed[0].model.misfit <= LACKING:
            return alone
    beside = tuple(m for m in lost if not _from_maps(found.model, m))
    if not beside:
        return alone
    plain = plain.fitted((*plain.terms, *beside))
    laws = _laws(plain, effect, rng)
    both = _both(found, plain, laws[0], rng) if laws else None
    other, than, _ = alone.confirmed
    if both is None or not _foretells(both[1], both[0].model, than, other.model):
        return alone
    return ByLaw(both, laws, told(laws, plain))


def names_of(model: Fitted) -> tuple[Candidate, ...]:
    """Terms of a model that are no maps."""
    return tuple(term for term in model.terms if not term.unexplained)


def without_maps(model: Fitted) -> Fitted:
    """A model without its maps."""
    named = names_of(model)
    return model if named == model.terms else model.fitted(named)


def _laws(plain: Fitted, effect: Effect, rng: np.random.Generator) -> tuple[Likely, ...]:
    """Laws of the residuals of a model without maps; they need the place of the machine."""
    return likely_laws(plain.beside, effect.robot, effect, rng) if plain.placed else ()


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
    other = HeldOutModels(model)
    if not _foretells(other, model, held, found.model):
        return found, held, said
    left = {m: f for m, f in said.items() if any(m.same_cause(term) for term in working)}
    return replace(found, model=model), other, left


def _from_maps(model: Fitted, lost: Candidate) -> bool:
    """Whether a map of the model could make most of the signal of a cause that was lost to it."""
    beside = model.fitted((*model.terms, lost))
    own, maps = beside.terms[-1], [term for term in beside.terms if term.unexplained]
    return not beside.scaled(own).any() or any(in_the_shadow(beside, own, m) for m in maps)


def _both(
    found: SearchResult, plain: Fitted, law: Likely, rng: np.random.Generator
) -> Confirmed | None:
    """The model of named causes and a law; None if one of the causes does not hold beside it."""
    model = fitted_with(plain, law.guess).rested()
    if not all(model.scaled(term).any() for term in model.terms):
        return None
    named, parts = (model.terms[: len(plain.terms)], model.terms[len(plain.terms) :])
    owed = IMPERFECT * sum(signal_of(model, part) for part in parts)
    held, said = HeldOutModels(model), {}
    found = replace(found, model=model)
    for term in named:
        finding = None
        if signal_of(model, term) > owed and term not in untrusted(model):
            finding = of_term(found, term, held, rng)
        if finding is None:
            return None
        said[term] = finding
    return found, held, said


def _foretells(held: HeldOutModels, model: Fitted, other: HeldOutModels, than: Fitted) -> bool:
    """Whether a model predicts held-out poses no worse than another one."""
    now, then = (
        each.mm(each.terms(of.terms, each.sectors)) for each, of in ((held, model), (other, than))
    )
    return now <= then
