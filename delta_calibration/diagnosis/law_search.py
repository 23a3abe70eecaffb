"""Search for a law of the grammar that explains the residuals: refinement, rivals, probability.

The best laws of the screen are refined, first with one shape for all targets of a law, then with
one shape for each target. They are compared with one another, with a smooth map of the same
structure and with no explanation at all, by their Bayes factor and prior,

    ln p = ln B + ln (prior of its family) - k ln (number of shapes of the family)

with k = 1, or the number of targets if each has its own shape. A law is reported if it is
probable, if it predicts enough of what it explains on held-out parts of the data, if it leaves
little more than noise, and if a smooth map adds nothing to it; else the structure stays unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from delta_calibration.diagnosis.candidates import (
    Candidate,
    all_columns,
    bounds_of,
    columns_of,
    maps,
)
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.constants import (
    COMPARED_LAWS,
    COMPLETE,
    FORETOLD,
    LACKING,
    LAW_ALIKE,
    LAW_BESIDE,
    LAW_EXPLAINS,
    LAW_FORETOLD,
    LAW_SHOWS,
    LAW_SURE,
    MODELLED,
    NAMED,
    PLAIN_WORDS,
    TEMPER,
    USUAL,
)
from delta_calibration.diagnosis.cross_validation import (
    Foretold,
    foretold,
    learnable,
    scattered,
    sectors,
    stretches,
)
from delta_calibration.diagnosis.law_grammar import COORDINATES, Grammar
from delta_calibration.diagnosis.law_screen import Case, Reshaped, Screen
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import PRECISION, Weighed, log_bayes, most_likely
from delta_calibration.effects import Effect, Stage
from delta_calibration.effects.found_law import FoundLaw
from delta_calibration.robot import Robot
from delta_calibration.threads import mapped

Array = NDArray[np.float64]

_FINER, _APART = 16, 16  # families whose shapes are refined, and refined for each target
_STEPS = 40  # evaluations for each field of a shape in its search
_ODD = {  # quantities that a stage hardly depends on, as far as known
    Stage.STRUCTURE: ("q", "direction", "acceleration"),
    Stage.MEASUREMENT: (),
    Stage.DRIVE: (),
}
_DRAWS = 16


@dataclass(frozen=True)
class Guess:
    """A candidate law: with one shape for all its targets, or one shape for each."""

    parts: tuple[FoundLaw, ...]
    log_p: float
    case: Case

    def with_sizes(self) -> tuple[FoundLaw, ...]:
        """The parts of the law with the typical sizes of their values filled in."""
        sizes = iter(self.case.size.tolist())
        return tuple(
            replace(part, typical=tuple(next(sizes) for _ in part.parameters))
            for part in self.parts
        )


@dataclass(frozen=True)
class Likely:
    """A probable law, the laws indistinguishable from it, and the best one that is not."""

    guess: Guess
    probability: float
    same: tuple[Guess, ...]
    rival: Guess | None


def likely_laws(
    evidence: LinearizedModel, robot: Robot, effect: Effect, rng: np.random.Generator
) -> tuple[Likely, ...]:
    """Find laws that explain the residuals, likeliest first; none if none is probable enough.

    Args:
        evidence: the residuals, with the causes found so far in its nuisance.
        robot: the machine.
        effect: any effect on it, from which the maps take robot and mechanism.
        rng: of the simulated noise.
    """
    if evidence.axes != COORDINATES:
        return ()
    grammar = Grammar.of(evidence, robot)
    screen = Screen(evidence, grammar.signals)
    guesses = _finer(screen, grammar.every)
    if not guesses or guesses[0].case.log_bayes < LAW_SHOWS:
        return ()
    nameless = best_map(evidence, effect, rng)
    classes = _classes(screen, guesses)
    top = max(guesses[0].log_p, nameless, 0.0)
    weights = [np.exp((own[0].log_p - top) / TEMPER) for own in classes]
    total = sum(weights) + sum(np.exp((other - top) / TEMPER) for other in (nameless, 0.0))
    found = []
    for own, weight in zip(classes, weights, strict=True):
        probability = COMPLETE * float(weight / total)
        if probability >= LAW_SURE and _holds(evidence, own[0], effect, rng):
            others = (g for other in classes if other is not own for g in other[:1])
            found.append(Likely(own[0], probability, tuple(own[1:]), next(others, None)))
    return tuple(found)


def doubts_of_names(
    evidence: LinearizedModel,
    named: Sequence[Candidate],
    grammar: Grammar,
    part: NDArray[np.int64],
    spare: float = 0.0,
) -> float:
    """Probability that a single law, and not the named causes, produced the readings.

    Several causes together can imitate one law of another form; the law then explains as much at
    a lower price, and so can one cause beside others. A law that explains only slightly more than
    a single cause raises no doubt if that is compared alone, or if both act on the same stage:
    effects of the catalogue are models, and machines differ from them by a few per cent, which
    another cause may seem to explain. Nor does a law raise doubt that predicts held-out parts no
    better than the causes do: it is simple, but it is not how the machine behaves.

    Args:
        evidence: the residuals without the causes.
        named: the causes.
        grammar: of the session, the same for all sets of causes.
        part: number of the part of the data that each sample is predicted with, (n,).
        spare: ln B that a law may owe to errors of other causes, which are in the evidence.
    """
    screen = Screen(evidence, grammar.signals)
    best = _likeliest(screen, grammar)
    if best is None or (len(named) == 1 and _is_its_law(named[0], best.parts[0])):
        return 0.0
    alone = [worth(evidence, [term]) for term in named]
    strongest = named[int(np.argmax(alone))].effect
    least = worth(evidence, named)
    if len(named) == 1 or (strongest and strongest.stage is best.parts[0].stage):
        least = max(least, (1 + MODELLED) * max(alone))
    ahead = best.log_p - least - spare
    if ahead > 0.0 and len(np.unique(part)) > 1:
        ahead = min(ahead, _foretold_more(screen, best, named, part))
    return float(expit(ahead / TEMPER))


def _is_its_law(term: Candidate, law: FoundLaw) -> bool:
    """Whether a law describes the same error as a cause: an error by direction is backlash."""
    if term.effect is None or law.by is not None or law.of.ahead:
        return False
    here = term.location is None or term.location in (target.part for target in law.targets)
    own = term.effect.stage, term.effect.simplest
    return here and own == (law.stage, (law.of.name, law.function))


def _foretold_more(
    screen: Screen, law: Guess, named: Sequence[Candidate], part: NDArray[np.int64]
) -> float:
    """ln p of held-out parts by a law, less that by the named causes; each fitted to the rest."""
    evidence, by_law = screen.evidence, Plain(screen.columns(law.parts) * law.case.size)
    free = np.full(len(law.case.size), np.inf)
    lower, upper = (np.concatenate(each) for each in zip(*map(bounds_of, named), strict=True))
    of_law = foretold(evidence, by_law, (-free, free), part).gain
    of_named = foretold(evidence, all_columns(named, evidence), (lower, upper), part).gain
    return (of_law - of_named) / 2


def likelier_than(log_bayes: float, evidence: LinearizedModel, grammar: Grammar) -> bool:
    """Whether a single law is likelier than an explanation of the residuals by ln B."""
    best = _likeliest(Screen(evidence, grammar.signals), grammar)
    return best is not None and best.log_p > log_bayes


def _likeliest(screen: Screen, grammar: Grammar) -> Guess | None:
    """The likeliest law of a grammar; None if the session can test no law."""
    return _finer(screen, grammar.every)[0] if grammar.every else None


def worth(evidence: LinearizedModel, named: Sequence[Candidate]) -> float:
    """ln B of several causes together, each with a size of its own."""
    columns = [columns_of(term, evidence) for term in named]
    ends = np.cumsum([0, *(each.shape[1] for each in columns)]).tolist()
    every = np.concatenate(columns, axis=1)
    information = evidence.information(every)
    along = (every.T @ evidence.weigh(evidence.column))[:, 0]
    lower, upper = zip(*(bounds_of(term) for term in named), strict=True)
    value = most_likely(information, along, np.concatenate(lower), np.concatenate(upper))
    spans = zip(named, pairwise(ends), strict=True)
    sized = [slice(*span) for term, span in spans if term.sized]
    return log_bayes(information, along, value, sized)


def _finer(screen: Screen, laws: Sequence[FoundLaw]) -> list[Guess]:
    """The best law of each family, refined in the best families; likeliest first."""
    priors = _Priors.of(laws)
    guesses = [
        Guess((law,), case.log_bayes + priors.of_law(law), case)
        for law, case in zip(laws, screen.cases(laws), strict=True)
    ]
    best: dict[Any, Guess] = {}
    for guess in sorted(guesses, key=lambda one: -one.log_p):
        best.setdefault(_family(guess.parts[0]), guess)
    chosen = list(best.values())
    finer = mapped(partial(_sharper, screen), chosen[:_FINER])
    finer.sort(key=lambda one: -one.log_p)
    apart = mapped(lambda guess: _apart(screen, guess, priors), finer[:_APART])
    return sorted((*finer, *(a for a in apart if a), *chosen[_FINER:]), key=lambda g: -g.log_p)


def _family(law: FoundLaw) -> tuple[Any, ...]:
    """Key of a law's family: everything but its shape."""
    return law.stage, law.targets, law.of, law.function, law.by


@dataclass(frozen=True)
class _Priors:
    """ln of each family's prior probability, and its number of shapes on the grid."""

    weight: dict[Any, float]
    shapes: dict[Any, int]

    @classmethod
    def of(cls, laws: Sequence[FoundLaw]) -> _Priors:
        """Priors by which a line is likelier than other functions, and one quantity than two."""
        shapes: dict[Any, int] = {}
        weight: dict[Any, float] = {}
        for law in laws:
            key = _family(law)
            shapes[key] = shapes.get(key, 0) + 1
            words = (law.function != "line") + (law.by is not None) + (law.of.ahead > 0)
            odd = law.of.name in _ODD[law.stage]
            weight[key] = PLAIN_WORDS**-words / (USUAL if odd else 1.0)
        total = float(np.log(sum(weight.values())))
        return cls({key: float(np.log(w)) - total for key, w in weight.items()}, shapes)

    def of_law(self, law: FoundLaw, apart: int = 1) -> float:
        """ln prior of a law in one shape, or in `apart` shapes if each target has its own."""
        key = _family(law)
        return self.weight[key] - apart * float(np.log(self.shapes[key]))


def _sharper(screen: Screen, guess: Guess) -> Guess:
    """The law in its best shape within the searched intervals."""
    parts, case = _best_shape(screen, guess.parts, 0, guess.case)
    return Guess(parts, guess.log_p + case.log_bayes - guess.case.log_bayes, case)


def _apart(screen: Screen, guess: Guess, priors: _Priors) -> Guess | None:
    """The law with a best shape for each target; None if there is no choice of shapes."""
    law = guess.parts[0]
    if len(law.targets) < 2 or not law.searched:
        return None
    parts, case = tuple(replace(law, targets=(target,)) for target in law.targets), guess.case
    for i in (*range(len(parts)), *range(len(parts))):
        parts, case = _best_shape(screen, parts, i, case)
    return Guess(parts, case.log_bayes + priors.of_law(law, len(parts)), case)


def _best_shape(
    screen: Screen, parts: tuple[FoundLaw, ...], i: int, now: Case
) -> tuple[tuple[FoundLaw, ...], Case]:
    """The parts with the best shape for part `i`, and their case; unchanged if none is better."""
    from scipy.optimize import minimize  # slow to load

    names = [name for name, _, _ in parts[i].searched]
    if not names:
        return parts, now
    low, high = (np.array([interval[k] for interval in parts[i].searched]) for k in (1, 2))

    def shaped(unit: Array) -> FoundLaw:
        values = low + np.clip(unit, 0.0, 1.0) * (high - low)
        fields: Any = dict(zip(names, values.tolist(), strict=True))
        return replace(parts[i], **fields)

    every = Reshaped(screen, parts, i)
    start = (np.array([getattr(parts[i], name) for name in names]) - low) / (high - low)
    simplex = np.vstack([start, *(np.clip(start + d, 0, 1) for d in _spread(start))])
    result = minimize(
        lambda unit: -every.case(shaped(unit)).log_bayes,
        start,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(names),
        options={
            "maxfev": _STEPS * len(names),
            "initial_simplex": simplex,
            "xatol": 1e-3,
            "fatol": 0.02,
        },
    )
    better = shaped(result.x)
    case = every.case(better)
    if not case.log_bayes > now.log_bayes:
        return parts, now
    return (*parts[:i], better, *parts[i + 1 :]), case


def _spread(start: Array) -> Array:
    """Steps of a first simplex from a start in the unit cube, pointing inward."""
    return cast(Array, np.diag(np.where(start > 0.5, -0.25, 0.25)))


def best_map(evidence: LinearizedModel, effect: Effect, rng: np.random.Generator) -> float:
    """ln B of the smooth map that explains the residuals best."""
    weighed = Weighed.of(evidence, np.inf, _DRAWS, rng)
    scores = mapped(lambda some: weighed.explore([some]), maps(evidence, effect))
    return max(score.log_bayes for some in scores for score in some)


def _classes(screen: Screen, guesses: Sequence[Guess]) -> list[list[Guess]]:
    """Classes of laws with nearly the same signal in these readings, likeliest first."""
    classes: list[tuple[Array, float, list[Guess]]] = []
    evidence, top = screen.evidence, guesses[0].log_p
    for guess in guesses[:COMPARED_LAWS]:
        if guess.log_p < top - 10 * TEMPER:
            break
        signal = screen.signal(guess.parts, guess.case)
        weighed = evidence.weigh(signal[:, None])[:, 0]
        length = float(signal @ weighed)
        for first, own, terms in classes:
            if float(first @ weighed) ** 2 > LAW_ALIKE * own * length:
                terms.append(guess)
                break
        else:
            classes.append((signal, length, [guess]))
    return [terms for _, _, terms in classes]


def _holds(
    evidence: LinearizedModel,
    guess: Guess,
    effect: Effect,
    rng: np.random.Generator,
) -> bool:
    """Whether the law predicts held-out parts of the data and explains nearly all of the error.

    A law that is only nearly right would be stated as surely as the right one: it would leave
    much, or a map would add to it.
    """
    columns = Plain(np.hstack([evidence.columns(p) for p in guess.with_sizes()]))
    free = np.full(columns.width, -np.inf), np.full(columns.width, np.inf)
    every = (sectors(evidence), stretches(evidence), scattered(evidence))
    parts = [part for part in every if learnable(evidence, columns, part).all()]
    shares = [_share(foretold(evidence, columns, free, part)) for part in parts]
    if not shares or min(shares) < LAW_FORETOLD:
        return False
    beside = evidence.beside(columns, np.full(columns.width, PRECISION))
    if _excess(beside) > (1 - LAW_EXPLAINS) * _excess(evidence):
        return False
    return best_map(beside, effect, rng) < LAW_BESIDE * guess.case.log_bayes


def _share(part: Foretold) -> float:
    """Share of what a law explains that it predicts.

    Dimensions beside it may take up much of what few parts show of it, and show less of it; then
    it counts whether the parts agree on its values.
    """
    some = part.share >= FORETOLD and part.gain >= NAMED
    return max(part.share, part.of_parts) if some else part.share


def _excess(evidence: LinearizedModel) -> float:
    """Chi square beyond that of noise, which may be somewhat larger than stated."""
    return (evidence.misfit - LACKING) * evidence.degrees
