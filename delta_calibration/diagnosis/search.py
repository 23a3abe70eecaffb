"""Which explanations hold, alone and together.

Greedy search takes the best explanation, puts it beside the nuisance and looks again. Because two
effects can hide behind a third, the set is then improved by swaps, additions and removals among
the best shapes of everything that was tried, and every pair of them is tried as well.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import (
    Candidate,
    columns_of,
    dimensions,
    maps,
    subsets,
)
from delta_calibration.diagnosis.evidence import Evidence
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.scores import (
    Score,
    Weighed,
    price_of,
)
from delta_calibration.diagnosis.together import Together, as_score, shadow, sizes
from delta_calibration.effects import Effect

Array = NDArray[np.float64]

ALPHA = 0.002  # chance that a clean session raises any alarm
MOST = 4  # effects at a time
_DRAWS = 64
_THREADS = min(4, os.cpu_count() or 1)
_SHORT = 30  # explanations that swaps and pairs are made of
_IMPERFECT = 2e-3  # share of what a model explains that it may get wrong itself
_NAMED = 80.0  # lambda that a cause beside another must have, to be told from its traces
# of the ln B of a map, or of a cause, that another cause must have to be fitted in its place
_RIVAL, _NEARLY = 0.25, 0.8
_LOOKED_AT = 3  # such others, at most
_SWAPS = 2  # rounds of them, at most
_PLAIN = 3.0  # ln B from which there is no doubt that something is left, or likelier


@dataclass(frozen=True)
class Scan:
    """Everything tried on one evidence, best first."""

    scores: tuple[Score, ...]
    tests: int  # how many questions were asked

    def significant(self, score: Score) -> bool:
        """Whether chance would give this much once in 1/ALPHA sessions, of all that was asked."""
        return bool(score.log_p + np.log(self.tests) < np.log(ALPHA))

    @property
    def left(self) -> Score | None:
        """The likeliest explanation of what is left, where that is plainly something."""
        return next(self._plain(), None)

    @property
    def map(self) -> Score | None:
        """The likeliest map of what is left, where that is plainly something."""
        return next((s for s in self._plain() if s.candidate.unexplained), None)

    def _plain(self) -> Iterator[Score]:
        good = (s for s in self.scores if s.log_bayes > _PLAIN and self.significant(s))
        return iter(sorted(good, key=lambda score: -score.log_bayes))

    @property
    def nameless(self) -> bool:
        """Whether something is left that a map explains better than any cause."""
        return self.left is not None and self.left.candidate.unexplained

    def without(self, causes: Sequence[Candidate]) -> Scan:
        """The scan without what is said to be of some causes."""
        kept = (s for s in self.scores if not any(s.candidate.same_cause(c) for c in causes))
        return Scan(tuple(kept), self.tests)

    def of_cause(self, candidate: Candidate) -> Score | None:
        """The best score of the same cause."""
        return next((s for s in self.scores if s.candidate.same_cause(candidate)), None)


def scan(
    evidence: Evidence,
    effects: Sequence[Effect],
    noise_degrees: float,
    rng: np.random.Generator,
    used: Sequence[Candidate] = (),
) -> Scan:
    """Score every explanation that is not used already."""
    weighed = Weighed.of(evidence, noise_degrees, _DRAWS, rng)
    questions = list(_questions(evidence, effects, used))
    questions.sort(key=len, reverse=True)  # the long searches first, so that no thread waits
    with ThreadPoolExecutor(_THREADS) as pool:
        scores = [score for some in pool.map(weighed.explore, questions) for score in some]
    scores.sort(key=lambda score: -score.log_bayes)
    return Scan(tuple(scores), len(scores))


def scanned(model: Fitted, effects: Sequence[Effect], rng: np.random.Generator) -> Scan:
    """What is left beside the members of a model."""
    return scan(model.beside, effects, model.noise_degrees, rng, model.members)


def _questions(
    evidence: Evidence, effects: Sequence[Effect], used: Sequence[Candidate]
) -> Iterator[list[list[Candidate]]]:
    """What to explore: for each effect its shapes, for each shape the whole and its parts."""
    for effect in effects:
        shapes = [shape for shape in effect.shapes(evidence.at) if not shape.missing(evidence.at)]
        groups = [
            [c for c in subsets(shape) if not any(_covers(other, c) for other in used)]
            for shape in shapes
        ]
        if groups and groups[0]:
            yield groups
    for group in (*([one] for one in dimensions(evidence)), *maps(evidence, effects[0])):
        if not any(_covers(other, group[0]) for other in used):
            yield [group]


def _covers(used: Candidate, candidate: Candidate) -> bool:
    """Whether all that the candidate could explain is in use."""
    if candidate.effect is None or used.effect is None:
        return used.effect is candidate.effect and used.rows == candidate.rows
    return used.same_cause(candidate) and set(candidate.rows) <= set(used.rows)


@dataclass(frozen=True)
class Found:
    """Where the search ended."""

    model: Fitted
    first: Scan  # of the session as it came
    last: Scan  # of what is left beside the members
    short: tuple[Score, ...]  # the best shape of everything worth a thought

    @property
    def tried(self) -> tuple[Score, ...]:
        """The best shape of each explanation, of maps only those that are worth anything."""
        every = {score.candidate.key: score for score in _worth_a_map(self.first)[::-1]}
        return tuple({**every, **{score.candidate.key: score for score in self.short}}.values())


def find(
    model: Fitted,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    begin: tuple[Candidate, ...] = (),
) -> Found:
    """Search until nothing significant is left.

    Args:
        model: the calibrated machine, without members.
        effects: the catalogue.
        rng: of the bootstrap.
        begin: members to begin with, which the search may exchange and drop.
    """
    starts = (model, *(() if begin else model.elsewhere()))
    scans = [scanned(start, effects, rng) for start in starts]
    bare, first = min(zip(starts, scans, strict=True), key=_left_by_the_best)
    model, here, swaps = bare, first, _SWAPS
    short: dict[str, Score] = {}
    seen: dict[tuple[str, ...], tuple[Fitted, Scan]] = {(): (bare, first)}
    while True:
        short.update({score.candidate.key: score for score in _shortlist(here)})
        members, begin = begin or _next_members(model, here, tuple(short.values())), ()
        back = seen.get(_keys(members))
        if _keys(members) in seen:
            members = _without_maps(model, effects, rng)
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
        here = scanned(model, effects, rng)
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
    sets += _pairs(bare, scans[0], list(named.values()), _worth(best))
    return _likeliest(bare, sets, (best, *named.values()))


def _pairs(
    model: Fitted, here: Scan, scores: Sequence[Score], enough: float
) -> list[tuple[Candidate, ...]]:
    """The best two of some explanations, where both hold and are worth more than enough."""
    worth = _Worth(Together.of(model.evidence, scores), here, model.noise_degrees)
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
    worth = _Worth(together, here, model.noise_degrees)
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
    with ThreadPoolExecutor(_THREADS) as pool:
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
    model: Fitted, effects: Sequence[Effect], rng: np.random.Generator
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
        best = worth_it(scanned(bare, effects, rng).without(others), bare)
        if best is not None and not best.candidate.unexplained:
            members = (*others, best.candidate)
    return members


def beyond_names(
    model: Fitted, here: Scan, short: tuple[Score, ...]
) -> tuple[Candidate, ...]:
    """The members, a map in the place of names that it is likelier than.

    Nothing is left beside true causes, and each does what no map does at its price. Beside one
    that does nearly as what nobody has described, the rest of that is left, for another map or a
    second name. What a map pays beyond its parameters (`shadow`) decides what is tried first, not
    what is true.
    """
    members, maps = model.members, [s for s in short if s.candidate.unexplained]
    named = [i for i, member in enumerate(members) if not member.unexplained]
    help_ = [here.left] if here.left is not None and here.nameless else []
    groups = [*([i] for i in named if help_), named]
    if not named or not maps:
        return members
    scores = [*(as_score(m, short) for m in members), *help_, *maps]
    together, helped = Together.of(model.evidence, scores), len(members) + len(help_)
    best, instead = together.fit(range(helped))[2], members
    if help_:  # a map is needed anyway: a name has to be plainly likelier than without it
        best -= _PLAIN
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


def _shortlist(here: Scan) -> list[Score]:
    """What swaps and pairs are made of, the best last."""
    best: dict[str, Score] = {}
    for score in _worth_a_map(here):
        best.setdefault(score.candidate.key, score)
    return list(best.values())[:_SHORT][::-1]


def _worth_a_map(here: Scan) -> list[Score]:
    """Everything but maps, which have many columns, that explain less than they cost."""
    return [s for s in here.scores if s.log_bayes > 0 or not s.candidate.unexplained]


def _next_members(model: Fitted, here: Scan, short: tuple[Score, ...]) -> tuple[Candidate, ...]:
    """The members with the best newcomer, after swaps; the first is taken as it is.

    About a fit without the first of them nothing is linear enough for finer choices.
    """
    best = worth_it(here, model) if len(model.members) < MOST else None
    if not model.members:
        return () if best is None else (best.candidate,)
    return _improved(model, here, best, short)


def worth_it(here: Scan, model: Fitted) -> Score | None:
    """The best explanation, if chance is out of the question and its parameters pay off."""
    explained = decrease_of(model)
    good = [
        score
        for score in here.scores
        if here.significant(score) and _worth(score) > 0 and score.gain > _least(explained)
    ]
    return max(good, key=_worth, default=None)


def _least(explained: float) -> float:
    """lambda that one more explanation must have beside what the others explain."""
    return max(_NAMED, _IMPERFECT * explained) if explained > _NAMED else 0.0


def decrease_of(model: Fitted) -> float:
    """How much chi square the members explain together."""
    without = float(np.sum(model.evidence.column * model.evidence.weigh(model.evidence.column)))
    return without - float(np.sum(model.beside.column * model.beside.weigh(model.beside.column)))


def _worth(score: Score) -> float:
    """ln B, less what a map pays."""
    return score.log_bayes - shadow(score.candidate, score.gain)


def _improved(
    model: Fitted, here: Scan, best: Score | None, short: tuple[Score, ...]
) -> tuple[Candidate, ...]:
    """The best set of explanations within a few swaps of the members and the best newcomer."""
    newcomers = [] if best is None else [best]
    pool = {score.candidate.key: score for score in short}
    for score in (*(as_score(m, short) for m in model.members), *newcomers):
        pool[score.candidate.key] = score
    scores = list(pool.values())
    together = Together.of(model.evidence, scores)
    where = {key: i for i, key in enumerate(pool)}  # a newcomer of a member's key takes its place
    begin = (*model.members, *(s.candidate for s in newcomers))
    start = tuple(sorted({where[c.key] for c in begin}))
    worth = _Worth(together, here, model.noise_degrees)
    chosen = start
    if newcomers:  # something else shows: two others may have been taken for one
        chosen = max((start, _best_pair(worth, len(scores))), key=worth)
    while True:
        near = max(_neighbours(chosen, len(scores)), key=worth, default=chosen)
        if worth(near) <= worth(chosen) + 1e-6:
            held = np.isfinite(worth(chosen))
            return tuple(together.candidates[i] for i in chosen) if held else model.members
        chosen = near


def _best_pair(worth: _Worth, count: int) -> tuple[int, ...]:
    """The best two of the candidates."""
    return max(combinations(range(count), 2), key=worth, default=())


def _neighbours(chosen: tuple[int, ...], count: int) -> Iterator[tuple[int, ...]]:
    """The set with one more, one less or one exchanged."""
    others = [i for i in range(count) if i not in chosen]
    for out in (None, *chosen):
        rest = [i for i in chosen if i != out]
        if out is not None and rest:
            yield tuple(rest)
        if out is not None or len(chosen) < MOST:
            for i in others:
                yield tuple(sorted([*rest, i]))


@dataclass
class _Worth:
    """How much a set of explanations is worth: ln B, if each of them holds beside the others."""

    together: Together
    here: Scan
    degrees: float
    known: dict[tuple[int, ...], float] = field(default_factory=dict)

    def __call__(self, chosen: tuple[int, ...]) -> float:
        """Minus infinity where one of them is not significant beside the others."""
        if chosen not in self.known:
            self.known[chosen] = self._of(chosen)
        return self.known[chosen]

    def _of(self, chosen: tuple[int, ...]) -> float:
        if not chosen:
            return 0.0
        candidates = self.together.candidates
        if any(candidates[i].same_cause(candidates[j]) for i, j in combinations(chosen, 2)):
            return -np.inf
        _, gain, log_b = self.together.fit(chosen)
        for i in chosen:
            rest = tuple(j for j in chosen if j != i)
            alone = gain - self.together.fit(rest)[1]
            log_p = self.together.chances[i].log_p(alone, self.degrees)
            log_p += float(np.log(self.together.tries[i]))
            if log_p + np.log(self.here.tests) > np.log(ALPHA) or alone < _least(gain - alone):
                return -np.inf
            log_b -= shadow(candidates[i], alone)
        return log_b
