"""Selection of a set of explanations about one fit: worth of a set, and search by swaps.

Greedy search takes the best explanation. Because a third effect can imitate two others, the set is
improved by swaps, additions and removals among the best shapes of everything that was tried, and
every pair of these is tried as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
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
    NEARLY_ALL,
    SHORT_LIST,
)
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.joint_fit import JointFit, as_score, shadow
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scan import Scan
from delta_calibration.diagnosis.scores import Chance, Score


def shortlist(here: Scan) -> list[Score]:
    """Candidates for swaps and pairs: the best score of each key, the best last."""
    best: dict[str, Score] = {}
    for score in worth_a_map(here):
        best.setdefault(score.candidate.key, score)
    return list(best.values())[:SHORT_LIST][::-1]


def worth_a_map(here: Scan) -> list[Score]:
    """All scores except those of maps that explain less than they cost: maps have many columns."""
    return [s for s in here.scores if s.log_bayes > 0 or not s.candidate.unexplained]


def next_terms(model: Fitted, here: Scan, short: tuple[Score, ...]) -> tuple[Candidate, ...]:
    """The terms with the best new one added, improved by swaps; the first is taken as it is.

    About a fit without the first of them the model is not linear enough for finer choices.
    """
    best = worth_it(here, model) if len(model.terms) < MOST else None
    if not model.terms:
        return () if best is None else (best.candidate,)
    return improved(model, here, best, short)


def worth_it(here: Scan, model: Fitted) -> Score | None:
    """The best explanation that is significant and worth its parameters; None if none is."""
    explained = decrease_of(model)
    good = [
        score
        for score in here.scores
        if worth_of(score) > 0
        and score.gain > least_of(explained, model, score.candidate, model.terms)
        and here.significant(score)
    ]
    return max(good, key=worth_of, default=None)


def least_of(
    explained: float, model: Fitted, one: Candidate, others: Sequence[Candidate]
) -> float:
    """Least lambda of one more explanation beside others.

    No model is perfect: what the others leave may be their own error, and then varies with what
    they vary with. A cause that varies with something else, and makes nearly all that they leave
    above the noise, is no such error.

    Args:
        explained: decrease of chi square by the others.
        model: any fit of the session.
        one: the explanation.
        others: the explanations beside it.
    """
    if not explained > NAMED:
        return 0.0
    least = IMPERFECT * explained
    if least > ANOTHER and not (one.depends_on & _kinds(others)):
        least = min(least, NEARLY_ALL * (excess_of(model) - explained))
    return max(ANOTHER, least)


def _kinds(others: Sequence[Candidate]) -> frozenset[str]:
    return frozenset().union(*(other.depends_on for other in others))


def excess_of(model: Fitted) -> float:
    """Chi square of a model without its terms, minus the degrees of freedom with its terms."""
    return _chi_square(model.evidence) - model.beside.degrees


def decrease_of(model: Fitted) -> float:
    """Decrease of chi square by all terms together."""
    return _chi_square(model.evidence) - _chi_square(model.beside)


def _chi_square(evidence: LinearizedModel) -> float:
    return float(np.sum(evidence.column * evidence.weigh(evidence.column)))


def worth_of(score: Score) -> float:
    """ln B, less the extra price of a map (`shadow`)."""
    return score.log_bayes - shadow(score.candidate, score.gain)


def improved(
    model: Fitted, here: Scan, best: Score | None, short: tuple[Score, ...]
) -> tuple[Candidate, ...]:
    """The best set of explanations reached by swaps from the terms and the best new one."""
    newcomers = [] if best is None else [best]
    pool = {score.candidate.key: score for score in short}
    for score in (*(as_score(m, short) for m in model.terms), *newcomers):
        pool[score.candidate.key] = score
    scores = list(pool.values())
    together = JointFit.of(model.evidence, scores)
    where = {key: i for i, key in enumerate(pool)}  # a newcomer replaces a term of the same key
    begin = (*model.terms, *(s.candidate for s in newcomers))
    start = tuple(sorted({where[c.key] for c in begin}))
    worth = Worth(together, here, model)
    chosen = start
    if newcomers:  # something is left: a single term may stand in for two other causes
        pair = worth.best(combinations(range(len(scores)), 2), default=start)
        chosen = max((start, pair), key=worth)
    while True:
        near = worth.best(_neighbours(chosen, len(scores)), default=chosen)
        if worth(near) <= worth(chosen) + 1e-6:
            held = np.isfinite(worth(chosen))
            return tuple(together.candidates[i] for i in chosen) if held else model.terms
        chosen = near


def _neighbours(chosen: tuple[int, ...], count: int) -> Iterator[tuple[int, ...]]:
    """Sets that differ from the chosen one by one addition, removal or exchange."""
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
    """Worth of a set of explanations: ln B, if each of them is significant beside the others."""

    together: JointFit
    here: Scan
    model: Fitted
    known: dict[tuple[int, ...], float] = field(default_factory=dict)
    fits: dict[tuple[int, ...], tuple[float, float]] = field(default_factory=dict)
    chances: dict[int, Chance] = field(default_factory=dict)

    def __call__(self, chosen: tuple[int, ...]) -> float:
        """Worth of a set; minus infinity if a member is not significant beside the others."""
        if chosen not in self.known:
            self.known[chosen] = self._of(chosen)
        return self.known[chosen]

    def most(self, chosen: tuple[int, ...]) -> float:
        """Upper bound of the worth of a set, ln B: one fit instead of one for each member."""
        candidates = self.together.candidates
        if any(candidates[i].same_cause(candidates[j]) for i, j in combinations(chosen, 2)):
            return -np.inf
        return self._fit(chosen)[1]

    def best(self, sets: Iterable[tuple[int, ...]], default: tuple[int, ...]) -> tuple[int, ...]:
        """The set of greatest worth, evaluated in the order of the bounds; else the default."""
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
            log_p = self._chance(i).log_p(alone, self.model.noise_degrees)
            log_p += float(np.log(self.together.tries[i]))
            others = [candidates[j] for j in rest]
            least = least_of(gain - alone, self.model, candidates[i], others)
            if log_p + np.log(self.here.tests) > np.log(ALPHA) or alone < least:
                return -np.inf
            log_b -= shadow(candidates[i], alone)
        return log_b

    def _chance(self, i: int) -> Chance:
        """What a candidate explains by chance, computed when first asked for."""
        if i not in self.chances:
            self.chances[i] = self.together.chance(i)
        return self.chances[i]

    def _fit(self, chosen: tuple[int, ...]) -> tuple[float, float]:
        """Decrease of chi square and ln B of a set, computed once: many sets share a subset."""
        if chosen not in self.fits:
            self.fits[chosen] = self.together.fit(chosen)
        return self.fits[chosen]
