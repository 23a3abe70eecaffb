"""Sets of explanations about one fit: what a set is worth, and the best within a few swaps.

Greedy search takes the best explanation. Because two effects can hide behind a third, the set is
improved by swaps, additions and removals among the best shapes of everything that was tried, and
every pair of them is tried as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.constants import (
    ALPHA,
    ANOTHER,
    IMPERFECT,
    MOST,
    NAMED,
    SHORT_LIST,
)
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.joint_fit import JointFit, as_score, shadow
from delta_calibration.diagnosis.scan import Scan
from delta_calibration.diagnosis.scores import Chance, Score


def shortlist(here: Scan) -> list[Score]:
    """What swaps and pairs are made of, the best last."""
    best: dict[str, Score] = {}
    for score in worth_a_map(here):
        best.setdefault(score.candidate.key, score)
    return list(best.values())[:SHORT_LIST][::-1]


def worth_a_map(here: Scan) -> list[Score]:
    """Everything but maps, which have many columns, that explain less than they cost."""
    return [s for s in here.scores if s.log_bayes > 0 or not s.candidate.unexplained]


def next_terms(model: Fitted, here: Scan, short: tuple[Score, ...]) -> tuple[Candidate, ...]:
    """The terms with the best newcomer, after swaps; the first is taken as it is.

    About a fit without the first of them nothing is linear enough for finer choices.
    """
    best = worth_it(here, model) if len(model.terms) < MOST else None
    if not model.terms:
        return () if best is None else (best.candidate,)
    return improved(model, here, best, short)


def worth_it(here: Scan, model: Fitted) -> Score | None:
    """The best explanation, if chance is out of the question and its parameters pay off."""
    explained = decrease_of(model)
    good = [
        score
        for score in here.scores
        if worth_of(score) > 0 and score.gain > _least(explained) and here.significant(score)
    ]
    return max(good, key=worth_of, default=None)


def _least(explained: float) -> float:
    """lambda that one more explanation must have beside what the others explain."""
    return max(ANOTHER, IMPERFECT * explained) if explained > NAMED else 0.0


def decrease_of(model: Fitted) -> float:
    """How much chi square the terms explain together."""
    without = float(np.sum(model.evidence.column * model.evidence.weigh(model.evidence.column)))
    return without - float(np.sum(model.beside.column * model.beside.weigh(model.beside.column)))


def worth_of(score: Score) -> float:
    """ln B, less what a map pays."""
    return score.log_bayes - shadow(score.candidate, score.gain)


def improved(
    model: Fitted, here: Scan, best: Score | None, short: tuple[Score, ...]
) -> tuple[Candidate, ...]:
    """The best set of explanations within a few swaps of the terms and the best newcomer."""
    newcomers = [] if best is None else [best]
    pool = {score.candidate.key: score for score in short}
    for score in (*(as_score(m, short) for m in model.terms), *newcomers):
        pool[score.candidate.key] = score
    scores = list(pool.values())
    together = JointFit.of(model.evidence, scores)
    where = {key: i for i, key in enumerate(pool)}  # a newcomer of a term's key takes its place
    begin = (*model.terms, *(s.candidate for s in newcomers))
    start = tuple(sorted({where[c.key] for c in begin}))
    worth = Worth(together, here, model.noise_degrees)
    chosen = start
    if newcomers:  # something else shows: two others may have been taken for one
        pair = worth.best(combinations(range(len(scores)), 2), default=start)
        chosen = max((start, pair), key=worth)
    while True:
        near = worth.best(_neighbours(chosen, len(scores)), default=chosen)
        if worth(near) <= worth(chosen) + 1e-6:
            held = np.isfinite(worth(chosen))
            return tuple(together.candidates[i] for i in chosen) if held else model.terms
        chosen = near


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
class Worth:
    """How much a set of explanations is worth: ln B, if each of them holds beside the others."""

    together: JointFit
    here: Scan
    degrees: float
    known: dict[tuple[int, ...], float] = field(default_factory=dict)
    fits: dict[tuple[int, ...], tuple[float, float]] = field(default_factory=dict)
    chances: dict[int, Chance] = field(default_factory=dict)

    def __call__(self, chosen: tuple[int, ...]) -> float:
        """Minus infinity where one of them is not significant beside the others."""
        if chosen not in self.known:
            self.known[chosen] = self._of(chosen)
        return self.known[chosen]

    def most(self, chosen: tuple[int, ...]) -> float:
        """What it is worth at most: ln B, one fit in the place of one for each of the set."""
        candidates = self.together.candidates
        if any(candidates[i].same_cause(candidates[j]) for i, j in combinations(chosen, 2)):
            return -np.inf
        return self._fit(chosen)[1]

    def best(self, sets: Iterable[tuple[int, ...]], default: tuple[int, ...]) -> tuple[int, ...]:
        """The set that is worth most, asked in the order of what they could be; or the default."""
        best, enough = default, -np.inf
        could = {chosen: self.most(chosen) for chosen in sets}
        for chosen in sorted(could, key=lambda each: -could[each]):
            if could[chosen] <= enough:
                break
            if self(chosen) > enough:
                best, enough = chosen, self(chosen)
        return best

    def _of(self, chosen: tuple[int, ...]) -> float:
        if not chosen:
            return 0.0
        candidates = self.together.candidates
        if not self.most(chosen) > -np.inf:
            return -np.inf
        gain, log_b = self._fit(chosen)
        for i in chosen:
            rest = tuple(j for j in chosen if j != i)
            alone = gain - self._fit(rest)[0]
            log_p = self._chance(i).log_p(alone, self.degrees)
            log_p += float(np.log(self.together.tries[i]))
            if log_p + np.log(self.here.tests) > np.log(ALPHA) or alone < _least(gain - alone):
                return -np.inf
            log_b -= shadow(candidates[i], alone)
        return log_b

    def _chance(self, i: int) -> Chance:
        """What one of them explains by chance, worked out when first asked for."""
        if i not in self.chances:
            self.chances[i] = self.together.chance(i)
        return self.chances[i]

    def _fit(self, chosen: tuple[int, ...]) -> tuple[float, float]:
        """Decrease of chi square and ln B; what is left of one set is left of many."""
        if chosen not in self.fits:
            self.fits[chosen] = self.together.fit(chosen)
        return self.fits[chosen]
