"""Which explanations hold, alone and together: fits of the sets that each fit suggests.

About one fit the best set is sought among linear signals (`sets`); it is fitted in full, and what
is then left suggests the next. Sets that rival it, a pair from the start, a cause in another's or
a map's place, are fitted as well, as what one fit hides another may show.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from delta_calibration.diagnosis.candidates import Candidate, columns_of
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.scan import PLAIN, THREADS, Scan, scanned
from delta_calibration.diagnosis.scores import Score, price_of
from delta_calibration.diagnosis.sets import (
    MOST,
    Worth,
    next_members,
    shortlist,
    worth_a_map,
    worth_it,
    worth_of,
)
from delta_calibration.diagnosis.together import Together, as_score, sizes
from delta_calibration.effects import Effect

# of the ln B of a map, or of a cause, that another cause must have to be fitted in its place
_RIVAL, _NEARLY = 0.25, 0.8
_LOOKED_AT = 3  # such others, at most
_SWAPS = 2  # rounds of them, at most


@dataclass(frozen=True)
class Found:
    """Where the search ended."""

    model: Fitted
    first: Scan  # of the session as it came
    last: Scan  # of what is left beside the members
    short: tuple[Score, ...]  # the best shape of everything worth a thought

    @property
    def mapped(self) -> bool:
        """Whether a map is among the members."""
        return any(member.unexplained for member in self.model.members)

    @property
    def tried(self) -> tuple[Score, ...]:
        """The best shape of each explanation, of maps only those that are worth anything."""
        every = {score.candidate.key: score for score in worth_a_map(self.first)[::-1]}
        return tuple({**every, **{score.candidate.key: score for score in self.short}}.values())


def find(
    model: Fitted,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    begin: tuple[Candidate, ...] = (),
    gone: tuple[Candidate, ...] = (),
) -> Found:
    """Search until nothing significant is left.

    Args:
        model: the calibrated machine, without members.
        effects: the catalogue.
        rng: of the bootstrap.
        begin: members to begin with, which the search may exchange and drop.
        gone: explanations that have been refused; nothing of the same cause is tried.
    """
    starts = (model, *(() if begin else model.elsewhere()))
    scans = [scanned(start, effects, rng).without(gone) for start in starts]
    bare, first = min(zip(starts, scans, strict=True), key=_left_by_the_best)
    model, here, swaps = bare, first, _SWAPS
    short: dict[str, Score] = {}
    seen: dict[tuple[str, ...], tuple[Fitted, Scan]] = {(): (bare, first)}
    while True:
        short.update({score.candidate.key: score for score in shortlist(here)})
        members, begin = begin or next_members(model, here, tuple(short.values())), ()
        back = seen.get(_keys(members))
        if _keys(members) in seen:
            members = _without_maps(model, effects, rng, gone)
        if _keys(members) in seen:
            members = beyond_names(model, here, tuple(short.values()))
        if _keys(members) not in seen:
            drawn = next((s for s in first.scores if (s.candidate,) == members), None)
            if drawn is not None and not model.members:
                model = _first_fit(bare, drawn, scans)
            else:
                model = model.fitted(members)
        else:
            if back is not None and here.left is not None and back[1].left is None:
                model, here = back  # in a circle, each set by what the other makes of its shapes
            swapped = _swapped(bare, model, here, tuple(short.values())) if swaps else model
            if swapped is model:
                return Found(model, first, here, tuple(short.values()))
            model, swaps = swapped, swaps - 1
        here = scanned(model, effects, rng).without(gone)
        seen[_keys(model.members)] = model, here


def _first_fit(bare: Fitted, best: Score, scans: Sequence[Scan]) -> Fitted:
    """With the best of a scan, or with what is likelier when fitted: a cause for a map, or two.

    What is fitted in the place of a strong cause hides it from a search about that fit.
    """
    named: dict[str, Score] = {}
    for score in sorted((s for here in scans for s in here.scores), key=lambda s: -s.log_bayes):
        if not score.candidate.unexplained:
            named.setdefault(score.candidate.cause, score)
    enough = _RIVAL if best.candidate.unexplained else np.inf
    rivals = [s for s in named.values() if s.log_bayes > enough * best.log_bayes]
    sets: list[tuple[Candidate, ...]] = [(s.candidate,) for s in (best, *rivals[:_LOOKED_AT])]
    sets += _pairs(bare, scans[0], list(named.values()), worth_of(best))
    return _likeliest(bare, sets, (best, *named.values()))


def _pairs(
    model: Fitted, here: Scan, scores: Sequence[Score], enough: float
) -> list[tuple[Candidate, ...]]:
    """The best two of some explanations, where both hold and are worth more than enough."""
    worth = Worth(Together.of(model.evidence, scores), here, model.noise_degrees)
    pairs = sorted(combinations(range(len(scores)), 2), key=worth, reverse=True)
    good = [pair for pair in pairs[:_LOOKED_AT] if worth(pair) > enough]
    return [tuple(scores[i].candidate for i in pair) for pair in good]


def _swapped(bare: Fitted, model: Fitted, here: Scan, short: tuple[Score, ...]) -> Fitted:
    """The fit with a cause in the place of another that does nearly as much, or of a map.

    Two take the place of one where they seem likelier already.

    Each set is fitted from the machine without any: about the fit of one the other is astray. The
    model itself where none is likelier.
    """
    members = model.members
    named = tuple(m for m in members if not m.unexplained)
    if not named:
        return model
    own = [as_score(m, short) for m in members]
    others = {
        s.candidate.cause: s
        for s in sorted(short, key=lambda s: s.log_bayes)
        if not s.candidate.unexplained and not any(s.candidate.same_cause(m) for m in members)
    }
    together, count = Together.of(model.evidence, [*own, *others.values()]), len(members)
    whole, sets = together.fit(range(count))[2], [] if count == 1 else [members]
    worth = Worth(together, here, model.noise_degrees)
    if len(named) < count:
        sets.append(named)
    for i, member in enumerate(members):
        kept = tuple(j for j in range(count) if j != i)
        least = together.fit(kept)[2]
        enough = -np.inf if member.unexplained else least + _NEARLY * (whole - least)
        new = range(count, count + len(others))
        one = [(together.fit((*kept, k))[2], (*kept, k)) for k in new]
        two = [(worth((*kept, *pair)), (*kept, *pair)) for pair in combinations(new, 2)]
        for near, least in ((one, enough), (two if len(kept) + 2 <= MOST else [], whole)):
            chosen = sorted((c for c in near if c[0] > least), reverse=True)[:_LOOKED_AT]
            sets += [tuple(together.candidates[j] for j in rows) for _, rows in chosen]
    return _likeliest(bare, sets, short, model)


def _likeliest(
    bare: Fitted,
    sets: Sequence[tuple[Candidate, ...]],
    tried: Sequence[Score],
    *known: Fitted,
) -> Fitted:
    """The fit with the likeliest of some sets of explanations, each fitted in full."""
    with ThreadPoolExecutor(THREADS) as pool:
        fits = [*known, *pool.map(bare.fitted, sets)]
    samples = bare.beside.degrees

    def likely(fit: Fitted) -> float:
        """ln B by chi square per degree of freedom: fits may set other poses aside."""
        columns = np.concatenate([columns_of(m, fit.evidence) for m in fit.members], axis=1)
        value = np.concatenate([fit.scaled(m) for m in fit.members])
        gain = samples * (bare.misfit - fit.misfit)
        information = fit.evidence.information(columns)
        price = price_of(information, value, sizes(fit.members))
        price += sum(float(np.log(as_score(m, tried).tries)) for m in fit.members)
        return gain / 2 - price

    return max(fits, key=likely)


def _keys(members: Sequence[Candidate]) -> tuple[str, ...]:
    return tuple(sorted(m.key for m in members))


def _without_maps(
    model: Fitted,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    gone: tuple[Candidate, ...] = (),
) -> tuple[Candidate, ...]:
    """The members, a cause in the place of a map wherever one is the best beside the others.

    Beside the map it would have had no shape of its own to be found by.
    """
    members = model.members
    for member in members:
        others = tuple(m for m in members if m is not member)
        if not member.unexplained or not others:
            continue
        bare = model.fitted(others)
        best = worth_it(scanned(bare, effects, rng).without((*others, *gone)), bare)
        if best is not None and not best.candidate.unexplained:
            members = (*others, best.candidate)
    return members


def beyond_names(model: Fitted, here: Scan, short: tuple[Score, ...]) -> tuple[Candidate, ...]:
    """The members, a map in the place of names that are not plainly likelier.

    Nothing is left beside true causes, and each does what no map does at its price. Beside one
    that does nearly as what nobody has described, the rest of that is left, for another map or a
    second name. A wrong name is worse than none. What a map pays beyond its parameters (`shadow`)
    decides what is tried first, not what is true.
    """
    members, maps = model.members, [s for s in short if s.candidate.unexplained]
    named = [i for i, member in enumerate(members) if not member.unexplained]
    help_ = [here.left] if here.left is not None and here.nameless else []
    groups = [*([i] for i in named if help_), named]
    if not named or not maps:
        return members
    scores = [*(as_score(m, short) for m in members), *help_, *maps]
    together, helped = Together.of(model.evidence, scores), len(members) + len(help_)
    best, instead = together.fit(range(helped))[2] - PLAIN, members
    for group in groups:
        others = [j for j in range(len(members)) if j not in group]
        for k in range(helped, len(scores)):
            chosen = tuple(together.candidates[j] for j in (*others, k))
            if any(one.same_cause(chosen[-1]) for one in chosen[:-1]):
                continue
            log_b = together.fit((*others, k))[2]
            if log_b > best:
                best, instead = log_b, chosen
    return instead


def _left_by_the_best(begun: tuple[Fitted, Scan]) -> float:
    """Chi square per degree of freedom that the best single explanation leaves."""
    model, here = begun
    gain = max((score.gain for score in here.scores), default=0.0)
    return model.misfit - gain / model.beside.degrees
