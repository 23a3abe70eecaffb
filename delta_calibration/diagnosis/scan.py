"""Scan of all candidate explanations of a session, each alone: Bayes factor and significance."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from delta_calibration.diagnosis.candidates import Candidate, dimensions, maps, subsets
from delta_calibration.diagnosis.constants import ALPHA, PLAIN
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import Score, Weighed, Weights
from delta_calibration.effects import Effect
from delta_calibration.threads import mapped

_DRAWS = 64


@dataclass(frozen=True)
class Scan:
    """Scores of all candidates tried on one evidence, best first."""

    scores: tuple[Score, ...]
    tests: int  # number of tests made, for the correction of p

    def significant(self, score: Score) -> bool:
        """Whether the F test, corrected for the number of tests, has p < ALPHA."""
        return bool(score.log_p + np.log(self.tests) < np.log(ALPHA))

    @property
    def left(self) -> Score | None:
        """The likeliest explanation of the residuals; None if evidence for it is not strong."""
        return next(self._strong(), None)

    @property
    def map(self) -> Score | None:
        """The likeliest map of the residuals; None if evidence for it is not strong."""
        return next((s for s in self._strong() if s.candidate.unexplained), None)

    @property
    def maps(self) -> tuple[Candidate, ...]:
        """All maps that were tried."""
        return tuple(s.candidate for s in self.scores if s.candidate.unexplained)

    def _strong(self) -> Iterator[Score]:
        return (s for s in self.scores if s.log_bayes > PLAIN and self.significant(s))

    @property
    def nameless(self) -> bool:
        """Whether structure is left that a map explains better than any cause."""
        return self.left is not None and self.left.candidate.unexplained

    def without(self, causes: Sequence[Candidate]) -> Scan:
        """The scan without the scores of some causes."""
        kept = (s for s in self.scores if not any(s.candidate.same_cause(c) for c in causes))
        return Scan(tuple(kept), self.tests)


def scan(
    evidence: LinearizedModel,
    effects: Sequence[Effect],
    noise_degrees: float,
    rng: np.random.Generator,
    used: Sequence[Candidate] = (),
    weights: Weights = (),
) -> Scan:
    """Score every explanation that is not yet in use.

    Args:
        evidence: the residuals to explain.
        effects: effects to try, in addition to dimensions and maps.
        noise_degrees: degrees of freedom of the noise estimate.
        rng: of the bootstrap.
        used: explanations that are already in the evidence.
        weights: factors by which causes are likelier than the average; 1 for all others.
    """
    weighed = replace(Weighed.of(evidence, noise_degrees, _DRAWS, rng), weights=weights)
    questions = [*_of_effects(evidence, effects, used), *_of_the_rest(evidence, effects, used)]
    scores = _explored(weighed, questions)
    return Scan(tuple(scores), len(scores))


def reshaped(
    model: Fitted, kept: Sequence[Candidate], effects: Sequence[Effect], rng: np.random.Generator
) -> list[Score]:
    """Scores of causes with several shapes, each in its best shape beside the kept terms."""
    evidence = beside(model.evidence, kept)
    weighed = Weighed.of(evidence, model.noise_degrees, _DRAWS, rng)
    weighed = replace(weighed, weights=_weights(model, effects))
    shapes = [each for each in _of_effects(evidence, effects, kept) if len(each) > 1]
    return _explored(weighed, shapes)


def _explored(weighed: Weighed, questions: list[list[list[Candidate]]]) -> list[Score]:
    questions.sort(key=len, reverse=True)  # long searches first, so that no thread waits
    every = (score for some in mapped(weighed.explore, questions) for score in some)
    scores = [score for score in every if score.candidate.sought]
    return sorted(scores, key=lambda score: -score.log_bayes)


def scanned(model: Fitted, effects: Sequence[Effect], rng: np.random.Generator) -> Scan:
    """Scan of what the terms of a model leave unexplained."""
    weights = _weights(model, effects)
    return scan(model.beside, effects, model.noise_degrees, rng, model.terms, weights)


def _weights(model: Fitted, effects: Sequence[Effect]) -> Weights:
    """Weight of each cause in machines of this type against the average cause, if known."""
    if model.population is None:
        return ()
    return model.population.weights([effect.cause for effect in effects])


def _of_effects(
    evidence: LinearizedModel, effects: Sequence[Effect], used: Sequence[Candidate]
) -> Iterator[list[list[Candidate]]]:
    """Candidates to explore: for each effect its shapes, for each shape the whole and parts.

    Shapes of another occasion of a cause, or of another `Effect.question`, are explored apart.
    """
    for effect in effects:
        shapes = [shape for shape in effect.shapes(evidence.at) if not shape.missing(evidence.at)]
        every = [[c.beside(used) for c in subsets(shape)] for shape in shapes]
        groups = [
            [c for c in group if not any(other.contains(c) for other in used)] for group in every
        ]
        questions: dict[Hashable, list[list[Candidate]]] = {}
        for shape, group in zip(shapes, groups, strict=True):
            if group:
                key = group[0].again, shape.question, tuple(c.rows for c in group)
                questions.setdefault(key, []).append(group)
        yield from questions.values()


def _of_the_rest(
    evidence: LinearizedModel, effects: Sequence[Effect], used: Sequence[Candidate]
) -> Iterator[list[list[Candidate]]]:
    """Candidates to explore that are no effects of the catalogue: dimensions and maps."""
    for group in (*([one] for one in dimensions(evidence)), *maps(evidence, effects[0])):
        if not any(other.contains(group[0]) for other in used):
            yield [group]
