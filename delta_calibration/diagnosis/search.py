"""Model search: find the set of explanations that holds, by repeated selection and full fits.

About one fit the best set is selected among linear signals (`model_selection.py`). It is fitted in
full, and the residuals then suggest the next set. Rival sets are fitted as well, because one fit
can show what another hides: a pair at the start, a cause in the place of another or of a map.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from threading import Lock

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.candidates import Candidate, all_columns, moved_by
from delta_calibration.diagnosis.constants import (
    ALPHA,
    LACKING,
    LOOKED_AT,
    LOST,
    MOST,
    NEARLY,
    PLAIN,
    REMAINS,
    RIVAL,
    SAME,
    SOME,
    SWAPS,
)
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.joint_fit import JointFit, as_score, sizes
from delta_calibration.diagnosis.model_selection import (
    Worth,
    next_terms,
    shortlist,
    worth_a_map,
    worth_it,
    worth_of,
)
from delta_calibration.diagnosis.rivals import equivalents, in_its_place
from delta_calibration.diagnosis.scan import Scan, reshaped, scanned
from delta_calibration.diagnosis.scores import Score, price_of
from delta_calibration.diagnosis.set_aside import Aside
from delta_calibration.effects import Effect
from delta_calibration.threads import mapped


@dataclass(frozen=True)
class SearchResult:
    """Result of the model search."""

    model: Fitted
    first: Scan  # of the session before any term was found
    last: Scan  # of the residuals beside the terms
    short: tuple[Score, ...]  # of each explanation short-listed, in the best shape last found
    fits: _Fits | None = None  # that were compared; None if the search began with terms

    @property
    def mapped(self) -> bool:
        """Whether a map is among the terms."""
        return any(term.unexplained for term in self.model.terms)

    @property
    def tried(self) -> tuple[Score, ...]:
        """The best shape of each explanation, without maps that explain less than they cost."""
        every = {score.candidate.key: score for score in worth_a_map(self.first)[::-1]}
        return tuple({**every, **{score.candidate.key: score for score in self.short}}.values())


@dataclass
class _Fits:
    """Full fits of sets of explanations, each started from the machine without any.

    The evidence of a fit is as large as the session: only the best fit so far keeps it.
    """

    bare: Fitted
    samples: float  # degrees of freedom for which chi square is stated
    known: dict[tuple[Hashable, ...], tuple[Fitted, float]] = field(default_factory=dict)
    best: tuple[Fitted | None, float] = (None, np.inf)
    swapped: dict[tuple[str, ...], float] = field(default_factory=dict)  # least cost by keys
    lock: Lock = field(default_factory=Lock)

    def of(self, sets: Sequence[tuple[Candidate, ...]]) -> list[tuple[Fitted, float]]:
        """Fits of the machine with each of these sets of explanations, each with its cost."""
        keys = [tuple(term.shape for term in terms) for terms in sets]
        every = zip(keys, sets, strict=True)
        new = {key: terms for key, terms in every if key not in self.known}
        self.known.update(zip(new, mapped(self._fitted, new.values()), strict=True))
        return [self.known[key] for key in keys]

    def of_swaps(
        self, sets: Sequence[tuple[Candidate, ...]], now: Fitted
    ) -> list[tuple[Fitted, float]]:
        """Fits of sets that may replace the terms of a model.

        A set that was much less likely (`LOST`) in an earlier round is not fitted again in other
        shapes.
        """
        enough = self.cost(now) + LOST
        some = [terms for terms in sets if self.swapped.get(_keys(terms), -np.inf) < enough]
        fits = self.of(some)
        for terms, (_, cost) in zip(some, fits, strict=True):
            keys = _keys(terms)
            self.swapped[keys] = min(cost, self.swapped.get(keys, np.inf))
        return fits

    def cost(self, fit: Fitted) -> float:
        """Minus ln of a fit's marginal likelihood, without the choice among candidates.

        Half the loss, the price of the values, and that of shapes chosen among several after the
        cause was found.
        """
        terms, evidence = fit.terms, fit.evidence
        value = np.concatenate([fit.scaled(m) for m in terms])
        information = evidence.information_of(all_columns(terms, evidence))
        price = price_of(information, value, sizes(terms))
        chosen = (m.effect for m in terms if m.effect is not None and m.effect.chosen)
        later = [_shapes_after(effect, evidence.at) for effect in chosen]
        return fit.loss(self.samples) / 2 + price + float(np.sum(np.log(later)))

    def _fitted(self, terms: tuple[Candidate, ...]) -> tuple[Fitted, float]:
        """A new fit and its cost; of it and the best so far, the worse releases its evidence."""
        fit = self.bare.fitted(terms)
        cost = self.cost(fit)
        with self.lock:
            worse, least = self.best
            if cost < least:
                self.best = fit, cost
            else:
                worse = fit
        if worse is not None:
            worse.forget()
        return fit, cost

    def keep_best(self) -> None:
        """Free the memory of all fits but the best; evidence may have been computed again."""
        for fit, _ in self.known.values():
            if fit is not self.best[0]:
                fit.forget()

    def forget(self) -> None:
        """Free the memory of all fits."""
        for fit, _ in ((self.bare, 0.0), *self.known.values()):
            fit.forget()


@dataclass
class _Next:
    """The best explanation beside sets of terms; each set is scanned once, in its first shapes."""

    effects: Sequence[Effect]
    rng: np.random.Generator
    gone: tuple[Candidate, ...] = ()
    known: dict[tuple[str, ...], Candidate | None] = field(default_factory=dict)

    def scanned(self, model: Fitted) -> Scan:
        """Scan of what the terms of a model leave."""
        here = scanned(model, self.effects, self.rng).without(self.gone)
        best = worth_it(here.without(model.terms), model)
        self.known[_keys(model.terms)] = None if best is None else best.candidate
        return here

    def best(self, model: Fitted, terms: tuple[Candidate, ...]) -> Candidate | None:
        """The best explanation beside some of a model's terms; None if none is worth it."""
        if _keys(terms) not in self.known:
            self.scanned(model.fitted(terms))
        return self.known[_keys(terms)]


def _shapes_after(effect: Effect, at: Conditions) -> int:
    """Number of shapes that were compared after a cause was found; 1 if it has no further ones."""
    shapes, refined = (
        sum(1 for _ in each) for each in (effect.shapes(at), effect.refinements(at))
    )
    return refined if refined > shapes else 1


def find(
    model: Fitted,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    begin: tuple[Candidate, ...] = (),
    gone: tuple[Candidate, ...] = (),
    earlier: SearchResult | None = None,
) -> SearchResult:
    """Search until nothing significant is left.

    Args:
        model: the calibrated machine, without terms.
        effects: the catalogue.
        rng: of the bootstrap.
        begin: terms to begin with, which the search may exchange and drop.
        gone: explanations that have been rejected; nothing of the same cause is tried.
        earlier: result of a search from the same model, whose first scan and fits are used again.
    """
    known = None if earlier is None else earlier.fits
    if earlier is None or known is None:
        starts = (model,) if begin else _starts(model, rng)
        every = [_Fits(start, model.beside.degrees) for start in starts]
        scans = [scanned(start.bare, effects, rng).without(gone) for start in every]
        fits, first = _likelier_start(every, scans)
    else:
        fits, first = replace(known, best=(None, np.inf)), earlier.first.without(gone)
        scans = [first]
    again = None if begin else fits  # for a search from the same start
    bare = model = fits.bare
    here, swaps, next_to = first, SWAPS, _Next(effects, rng, gone)
    short: dict[str, Score] = {}
    seen: dict[tuple[str, ...], tuple[Fitted, Scan]] = {(): (bare, first)}
    while True:
        short.update({score.candidate.key: score for score in shortlist(here)})
        terms, begin = begin or next_terms(model, here, tuple(short.values())), ()
        back = seen.get(_keys(terms))
        if _keys(terms) in seen:
            terms = _without_maps(model, next_to)
        if _keys(terms) in seen:
            terms = beyond_names(model, here, tuple(short.values()))
        if _keys(terms) not in seen:
            drawn = next((s for s in first.scores if (s.candidate,) == terms), None)
            if drawn is not None and not model.terms:
                model = _first_fit(fits, drawn, scans)
            else:
                model = model.fitted(terms)
        else:
            if back is not None and here.left is not None and back[1].left is None:
                model, here = back  # the search alternates between sets; this one leaves nothing
            if swaps and len(model.terms) > 1:
                short.update(_other_shapes(model, effects, rng, tuple(short.values()), gone))
            swapped = _swapped(fits, model, here, tuple(short.values())) if swaps else model
            if swapped is model:
                return SearchResult(model, first, here, tuple(short.values()), again)
            model, swaps = swapped, swaps - 1
        fitted, model = model, _refined(fits, model, tuple(short.values()))
        here = next_to.scanned(model)
        for other, _ in seen.values():
            if other is not bare and other is not model:
                other.forget()
        seen[_keys(fitted.terms)] = seen[_keys(model.terms)] = model, here


def _first_fit(fits: _Fits, best: Score, scans: Sequence[Scan]) -> Fitted:
    """The fit with the best score of a scan, or with a rival that is likelier when fitted in full.

    Rivals are its other shapes, causes in the place of a map, the likeliest of them in its other
    shapes as well, and pairs. A wrong explanation in the place of a strong cause would hide it
    from a search about that fit.
    """
    named: dict[str, Score] = {}
    for score in sorted((s for here in scans for s in here.scores), key=lambda s: -s.log_bayes):
        if not score.candidate.unexplained:
            named.setdefault(score.candidate.cause, score)
    enough = RIVAL if best.candidate.unexplained else np.inf
    rivals = [s for s in named.values() if s.log_bayes > enough * best.log_bayes]
    sets: list[tuple[Candidate, ...]] = [(s.candidate,) for s in (best, *rivals[:LOOKED_AT])]
    nearest = _likeliest(fits, fits.of(sets[1:] or sets), (best, *named.values()))
    sets += nearest.in_other_shapes
    fits.keep_best()
    sets += _pairs(fits.bare, scans[0], list(named.values()), worth_of(best))
    return _likeliest(fits, fits.of(sets), (best, *named.values()))


def _pairs(
    model: Fitted, here: Scan, scores: Sequence[Score], enough: float
) -> list[tuple[Candidate, ...]]:
    """The best pairs of some explanations that hold together and are worth more than `enough`."""
    worth = Worth(JointFit.of(model.evidence, scores), here, model)
    pairs = sorted(combinations(range(len(scores)), 2), key=worth, reverse=True)
    good = [pair for pair in pairs[:LOOKED_AT] if worth(pair) > enough]
    return [tuple(scores[i].candidate for i in pair) for pair in good]


def _other_shapes(
    model: Fitted,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    short: tuple[Score, ...],
    gone: tuple[Candidate, ...],
) -> dict[str, Score]:
    """Scores of other causes by key, each in the shape that best replaces one of the terms.

    The shapes are searched beside the other terms: a step searched about a fit without these may
    have been found at any moment.
    """
    terms, every = model.terms, range(len(model.terms))
    together = JointFit.of(model.evidence, [as_score(m, short) for m in terms])
    best: dict[str, tuple[float, Score]] = {}
    for i in every:
        kept = tuple(j for j in every if j != i)
        does = together.fit(every)[1] - together.fit(kept)[1]
        for score in reshaped(model, [terms[j] for j in kept], effects, rng):
            near, key = score.log_bayes - does, score.candidate.key
            if key not in best or near > best[key][0]:
                best[key] = near, score
    return {
        key: score
        for key, (_, score) in best.items()
        if not any(score.candidate.same_cause(m) for m in (*terms, *gone))
    }


def _swapped(fits: _Fits, model: Fitted, here: Scan, short: tuple[Score, ...]) -> Fitted:
    """The likeliest fit after replacing one term; the model itself if no other is likelier.

    A cause is replaced by another that explains nearly as much, a map by any cause. Two causes
    replace one term if they seem likelier already. A cause is tried in its best other shape as
    well, because its own was chosen about a fit without it.

    Each set is fitted from the machine without any: about the fit of one set another is not
    linear.
    """
    terms = model.terms
    named = tuple(m for m in terms if not m.unexplained)
    if not named:
        return model
    own = [as_score(m, short) for m in terms]
    others = _in_their_place(model, short)
    together, count = JointFit.of(model.evidence, [*own, *others.values()]), len(terms)
    whole, sets = together.fit(range(count))[1], [] if count == 1 else [terms]
    worth = Worth(together, here, model)
    if len(named) < count:
        sets.append(named)
    sets += model.in_other_shapes
    sets += model.at_strongest_place
    sets += _with_all_values(terms)
    for i, term in enumerate(terms):
        kept = tuple(j for j in range(count) if j != i)
        least = together.fit(kept)[1]
        enough = -np.inf if term.unexplained else least + NEARLY * (whole - least)
        new = range(count, count + len(others))
        one = [(together.fit((*kept, k))[1], (*kept, k)) for k in new]
        both = [(*kept, *pair) for pair in combinations(new, 2)] if len(kept) + 2 <= MOST else []
        two = [(worth(rows), rows) for rows in both if worth.most(rows) > whole]
        for near, least in ((one, enough), (two, whole)):
            chosen = sorted((c for c in near if c[0] > least), reverse=True)[:LOOKED_AT]
            sets += [tuple(together.candidates[j] for j in rows) for _, rows in chosen]
    return _likeliest(fits, fits.of_swaps(sets, model), short, model)


def _with_all_values(terms: tuple[Candidate, ...]) -> Iterator[tuple[Candidate, ...]]:
    """The terms without one of them, and with all values of another one free instead.

    A cause of the whole machine found with a part of its values leaves what the others do, and a
    second cause may take their place: a tracker that was shifted and turned, as a shift and a
    joint that slipped.
    """
    for i, term in enumerate(terms):
        whole = term.with_all_values
        if term.location is None and not term.unexplained and len(whole.rows) > len(term.rows):
            for j in range(len(terms)):
                if j != i:
                    yield tuple(whole if k == i else m for k, m in enumerate(terms) if k != j)


def _in_their_place(model: Fitted, short: tuple[Score, ...]) -> dict[str, Score]:
    """Other causes by name, each in the shape that best replaces the term it is most like."""
    others = {
        s.candidate.cause: s
        for s in sorted(short, key=lambda s: s.log_bayes)
        if not s.candidate.unexplained and not any(s.candidate.same_cause(m) for m in model.terms)
    }
    near = dict.fromkeys(others, 0.0)
    for term in model.terms:
        evidence = beside(model.evidence, tuple(m for m in model.terms if m is not term))
        signal = moved_by(term, evidence, model.scaled(term))
        # a cause that already makes all of the signal is fitted in any case, in its own shape
        for share, score in in_its_place(evidence, signal, tuple(others.values()), SAME**2):
            cause = score.candidate.cause
            if share > near[cause]:
                near[cause], others[cause] = share, score
    return others


def _refined(fits: _Fits, model: Fitted, short: tuple[Score, ...]) -> Fitted:
    """The fit with other shapes of its causes, as long as one removes much of the misfit.

    Other shapes are tried before further explanations, because several maps and causes together
    can imitate what a shape lacks, such as the second order of a gear.
    """
    while model.misfit > LACKING:
        sets = [*model.in_other_shapes, *_beside_a_twin(model, short)]
        refined = _likeliest(fits, fits.of(sets), short, model)
        if not model.misfit - refined.misfit > REMAINS * (model.misfit - 1):
            break
        model = refined
    return model


def _beside_a_twin(model: Fitted, short: tuple[Score, ...]) -> Iterator[tuple[Candidate, ...]]:
    """The terms with one in another shape, and the cause that it was like beside it.

    In their first shapes two causes may be one: backlash that loads never decide and friction that
    winds up a spring. Then neither the one's shape nor the other alone explains what both do.
    """
    if len(model.terms) == MOST:
        return
    others = [s for s in short if not any(s.candidate.same_cause(m) for m in model.terms)]
    for terms in model.in_other_shapes:
        own = next(m for m in model.terms if all(m is not kept for kept in terms))
        evidence = beside(model.evidence, tuple(m for m in model.terms if m is not own))
        signal = moved_by(own, evidence, model.scaled(own))
        for twin in equivalents(evidence, signal, others, model.misfit)[:1]:
            yield (*terms, twin)


def _likeliest(
    fits: _Fits,
    fitted: Sequence[tuple[Fitted, float]],
    tried: Sequence[Score],
    *known: Fitted,
) -> Fitted:
    """The likeliest of some fits with their costs and of known ones, whose costs are computed."""

    def price_of_choice(fit: Fitted) -> float:
        return sum(float(np.log(as_score(m, tried).tries * m.choices)) for m in fit.terms)

    every = [*((fit, fits.cost(fit)) for fit in known), *fitted]
    best, _ = min(every, key=lambda one: one[1] + price_of_choice(one[0]))
    return best


def _keys(terms: Sequence[Candidate]) -> tuple[str, ...]:
    return tuple(sorted(m.key for m in terms))


def _without_maps(model: Fitted, next_to: _Next) -> tuple[Candidate, ...]:
    """The terms, with a map replaced by a cause if one is best in a scan without that map.

    A scan with the map in the model would not have found the cause, as the map imitates it.
    """
    terms = model.terms
    for term in terms:
        others = tuple(m for m in terms if m is not term)
        if not term.unexplained or not others:
            continue
        best = next_to.best(model, others)
        if best is not None and not best.unexplained:
            terms = (*others, best)
    return terms


def beyond_names(model: Fitted, here: Scan, short: tuple[Score, ...]) -> tuple[Candidate, ...]:
    """The terms, with a map in the place of named causes that are not clearly likelier.

    Beside the true causes nothing is left, and no map explains as much as one at its price. If a
    cause only resembles an effect that is in no catalogue, the rest of that effect is left, for
    another map or a second name. A wrong name is worse than none. Causes that explain nearly all
    that the map does (`SOME`), apart from what chance gives to a map's many weights, need only be
    as likely as the map: no model is perfect. The extra price of a map (`shadow`) decides what is
    tried first, not what is true.
    """
    terms, maps = model.terms, [s for s in short if s.candidate.unexplained]
    named = [i for i, term in enumerate(terms) if not term.unexplained]
    help_ = [here.left] if here.left is not None and here.nameless else []
    groups = [*([i] for i in named if help_), named]
    if not named or not maps:
        return terms
    scores = [*(as_score(m, short) for m in terms), *help_, *maps]
    together, helped = JointFit.of(model.evidence, scores), len(terms) + len(help_)
    explained, names = together.fit(range(helped))
    by_chance = [together.chance(i).mean for i in range(len(scores))]
    best, instead = -np.inf, terms
    for group in groups:
        others = [j for j in range(len(terms)) if j not in group]
        nearly_all = explained + SOME * (explained - together.fit(others)[0])
        replaced = sum(by_chance[i] for i in range(helped) if i not in others)
        for k in range(helped, len(scores)):
            chosen = tuple(together.candidates[j] for j in (*others, k))
            if any(one.same_cause(chosen[-1]) for one in chosen[:-1]):
                continue
            gain, log_b = together.fit((*others, k))
            further = max(0.0, by_chance[k] - replaced)
            likelier = log_b + (PLAIN if gain > nearly_all + further else 0.0) > names
            if likelier and log_b > best:
                best, instead = log_b, chosen
    return instead


def _starts(model: Fitted, rng: np.random.Generator) -> tuple[Fitted, ...]:
    """Fits from which the search may begin: the machine's, and others that show more."""
    whole = _with_outliers(model, rng)
    return (model, *model.elsewhere(), *(() if whole is model else (whole,)))


def _with_outliers(model: Fitted, rng: np.random.Generator) -> Fitted:
    """The fit with the poses in use that it set aside and that miss alike; itself if none do.

    A joint that slipped early leaves a few poses far off all others: one cause, not gross errors.
    """
    alike = Aside.of(model, rng).alike
    return model.readmitted() if alike is not None and alike < ALPHA else model


def _likelier_start(starts: Sequence[_Fits], scans: Sequence[Scan]) -> tuple[_Fits, Scan]:
    """The start from which the best explanation, fitted in full, is likeliest, and its scan."""
    if len(starts) == 1:
        return starts[0], scans[0]
    cost = [_cost_of_the_best(*begun) for begun in zip(starts, scans, strict=True)]
    best = int(np.argmin(cost))
    for i, other in enumerate(starts):
        if i != best:
            other.forget()
    return starts[best], scans[best]


def _cost_of_the_best(start: _Fits, here: Scan) -> float:
    """Cost of the likeliest explanation of a scan, fitted in full in its best shape."""
    ((fit, cost),) = start.of([tuple(score.candidate for score in here.scores[:1])])
    return min([cost, *(other for _, other in start.of(fit.in_other_shapes))])
