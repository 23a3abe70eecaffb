"""Interface of a fit for the diagnosis, whatever was measured: evidence, terms and values.

A session of a tracker (`model.py`) and observations of any kinds (`observed.py`) are each fitted
in their own way; the search, the tests and the verdict use only this interface.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.diagnosis.candidates import (
    Candidate,
    all_columns,
    bounds_of,
    columns_of,
    shape_columns,
    subsets,
)
from delta_calibration.diagnosis.constants import NEARLY
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.memo import Memo
from delta_calibration.diagnosis.scores import PRECISION, most_likely_of_each
from delta_calibration.diagnosis.shapes import Shapes
from delta_calibration.diagnosis.verdict import SessionFacts
from delta_calibration.effects import Effect, Interval
from delta_calibration.estimation import Population, Problem, placing, registered
from delta_calibration.lazy import cached_property
from delta_calibration.theta import Layout, entries
from delta_calibration.threads import mapped

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ZOOMS, _POINTS, _STEPS = 3, 9, 8
_SAME = 1e-9  # share of a decrease of chi square that is rounding error
_NOTHING = np.zeros(0, dtype=np.int64)


class Fitted(ABC):
    """A fit of geometry, frame and the terms found so far; the model is linearized about it."""

    problem: Problem  # its chain without effects
    theta: Array  # (P,) of the chain with the terms' effects
    terms: tuple[Candidate, ...]
    memo: Memo

    @property
    def bare(self) -> Chain:
        """The chain without effects."""
        return self.problem.chain

    @property
    def placed(self) -> bool:
        """Whether the frame of the measuring device is fitted."""
        return bool(self.problem.free[self.problem.layout.frame].any())

    @property
    def extended(self) -> Problem:
        """The problem with the terms' effects in its chain."""
        return self.memo.of("extended", self._extended)

    def _extended(self) -> Problem:
        effects = tuple(m.effect for m in self.terms if m.effect is not None)
        chain = self.problem.chain.with_effects(effects)
        layout = self.problem.layout.with_effects(chain.layout.effect_sizes)
        base, own = layout.base, chain.parameters.prior[chain.layout.effects]
        basis = np.zeros((layout.size, layout.size))
        basis[base, base] = self.problem.basis
        basis[layout.effects, layout.effects] = np.diag(own)
        new = np.ones(len(own), dtype=bool)
        return replace(
            self.problem,
            chain=chain,
            theta0=np.concatenate([self.problem.theta0, np.zeros(len(own))]),
            basis=basis,
            has_prior=np.concatenate([self.problem.has_prior, new]),
            free=np.concatenate([self.problem.free, new]),
        )

    @property
    def population(self) -> Population | None:
        """Population of the machines of this type; None if it is not known."""
        return None

    @property
    def evidence(self) -> LinearizedModel:
        """Linearized residuals as if the terms were not in the model, gathered once."""
        return self.memo.of("evidence", self.gathered)

    @abstractmethod
    def gathered(self) -> LinearizedModel:
        """Compute the evidence of all that was measured."""

    @property
    @abstractmethod
    def noise_degrees(self) -> float:
        """Degrees of freedom of the noise estimate; infinite where the noise is known."""

    @property
    @abstractmethod
    def noise_apart(self) -> bool:
        """Whether the noise is known apart from the residuals; if not, no fit is a bad one."""

    @property
    @abstractmethod
    def floor(self) -> float:
        """Root mean square error of a sample due to noise [m]."""

    @property
    @abstractmethod
    def facts(self) -> SessionFacts:
        """Number of readings and poses, duration, and how many readings were left out."""

    @abstractmethod
    def fitted(self, terms: tuple[Candidate, ...]) -> Fitted:
        """The model with these terms instead."""

    @abstractmethod
    def elsewhere(self) -> tuple[Fitted, ...]:
        """Other starting points, if a cause missing from the model may have misled the fit."""

    @abstractmethod
    def quieter(self, found: Fitted) -> Fitted:
        """The fit with less noise, if the causes found explain a part of the estimated noise."""

    @property
    def most_louder(self) -> float:
        """Largest factor on the noise that is possible; 1 if the noise is known."""
        return 1.0

    def louder(self, factor: float) -> Fitted:
        """The fit with its noise times a factor; the same fit if the noise is known."""
        del factor
        return self

    def loosened(self, scatter: float) -> Fitted:
        """The same fit, with the prior of every dimension `scatter` of its tolerances wide."""
        del scatter
        return self

    @abstractmethod
    def rested(self) -> Fitted:
        """The same model with all unknowns converged on all that was measured."""

    def placed_freely(self) -> Fitted:
        """The same fit with a reflector that may sit anywhere, if one is fitted."""
        return self

    def everything(self) -> Fitted:
        """The same fit, with the poses that it set aside as gross errors included again."""
        return self

    def readmitted(self) -> Fitted:
        """The same fit, with those poses in use again that it set aside and that miss alike."""
        return self

    def registered(self, known: Array | None = None) -> Fitted:
        """The nominal machine in its best-fit placement, see `estimation.registered`.

        Args:
            known: known geometry instead of the nominal one, (p,).
        """
        problem, geometry = self.problem, self.problem.layout.geometry
        theta, sure = problem.theta0.copy(), problem.has_prior.copy()
        if known is None:
            theta[geometry] = self.bare.mechanism.parameters.nominal
        else:
            theta[geometry], sure[geometry] = known, True
        problem = replace(problem, theta0=theta, has_prior=sure)
        placed: Fitted = replace(cast(Any, self), problem=problem, terms=())
        somewhere = placing(problem).any()  # false if only encoders were read
        return placed.at(registered(problem).theta if somewhere else problem.theta0)

    def at(self, theta: Array) -> Fitted:
        """The same fit with other values theta, (P,)."""
        return cast(Fitted, replace(cast(Any, self), theta=theta))

    def resting_as(self, other: Fitted) -> Fitted:
        """The fit with geometry, reflector and frame of another fit."""
        theta, base = self.theta.copy(), self.layout.base
        theta[base] = other.theta[base]
        return self.at(theta)

    @property
    def unplaced(self) -> Index:
        """Indices of nuisance parameters that are errors of the machine, not its placement."""
        base = self.problem.layout.base
        return np.flatnonzero(~placing(self.problem)[base])

    def forget(self) -> None:
        """Drop what is as large as the session; it is recomputed on demand."""
        self.memo.forget("extended", "evidence", "beside")

    @property
    def beside(self) -> LinearizedModel:
        """The evidence with the terms' columns added to its nuisance, so that they are fitted."""
        return self.memo.of("beside", lambda: beside(self.evidence, self.terms))

    @property
    def misfit(self) -> float:
        """Chi square per degree of freedom with the terms in the model."""
        return self.beside.misfit

    @abstractmethod
    def loss(self, samples: float) -> float:
        """-2 ln of the likelihood of this fit, less a constant of the session.

        Args:
            samples: degrees of freedom for which it is stated, as fits may use different samples.
        """

    @property
    def layout(self) -> Layout:
        """Layout of theta; each term is an effect, empty if it is a dimension."""
        return theta_layout(self.problem.layout, self.terms)

    @property
    def chain_theta(self) -> Array:
        """Theta of the chain, without the mounting of a probe."""
        return self.theta[self.layout.chain]

    @property
    def column_layout(self) -> Layout:
        """Layout of the columns of `beside`; each term is an effect with its free parameters.

        A term that is a dimension has a column of its own, beside that of the geometry.
        """
        sizes = [(m.cause, len(m.rows)) for m in self.terms]
        return self.problem.layout.with_effects(sizes)

    @property
    def effect_values(self) -> tuple[Array, ...]:
        """All parameters of each term that is an effect, (k,) each, in their own units."""
        effects = tuple(m.effect for m in self.terms if m.effect is not None)
        return self.bare.with_effects(effects).effect_values(self.chain_theta)

    def values(self, term: Candidate) -> Array:
        """Values of a term's free parameters, (k,), in their own units."""
        if term.effect is None:
            return np.asarray(self.theta[list(term.rows)])
        own = self.layout.effect(self.terms.index(term))
        return np.asarray(self.theta[own][list(term.rows)])

    def scaled(self, term: Candidate) -> Array:
        """Values of a term's free parameters in units of their priors, (k,)."""
        if term.effect is None:
            rows = list(term.rows)
            off = self.values(term) - self.problem.theta0[rows]
            return np.asarray(off / np.diag(self.problem.basis)[rows])
        prior = term.effect.parameters.prior[list(term.rows)]
        return np.asarray(self.values(term) / prior)

    def ahead(self, misfit: float = 1.0, held: Index = _NOTHING) -> Array:
        """Theta (P,) after one Gauss-Newton step of geometry, frame and terms.

        Args:
            misfit: chi square per degree of freedom, see `LinearizedModel.best`.
            held: indices of the nuisance parameters that stay unchanged.
        """
        problem, base = self.extended, self.layout.base
        now = np.asarray(np.linalg.solve(problem.basis, self.theta - problem.theta0), dtype=float)
        z = self.beside.best(misfit, held, now[held])
        theta = problem.theta0.copy()
        theta[base] += problem.basis[base, base] @ z[base]
        parts = zip(self.terms, self.layout.each, self.column_layout.each, strict=True)
        for term, own, columns in parts:
            rows, v = np.array(term.rows), z[columns]
            if term.effect is None:
                theta[rows] += np.diag(problem.basis)[rows] * v
            else:
                v = np.clip(v, *bounds_of(term))  # for example, no negative gap
                theta[entries(own)[rows]] = term.effect.parameters.prior[rows] * v
        return theta

    def refined(self) -> tuple[Candidate, ...]:
        """The terms with the shapes that follow from their current values."""
        values = iter(self.effect_values)
        return tuple(m if m.effect is None else _reshaped(m, next(values)) for m in self.terms)

    @cached_property
    def in_other_shapes(self) -> tuple[tuple[Candidate, ...], ...]:
        """Variants of the terms, each with one term in its best other shape, if nearly as good.

        Only shapes that refining the term's own cannot reach. They are compared about this fit:
        when the term's shape was chosen, other terms were not in the model yet.
        """
        terms = self.terms
        every = enumerate(mapped(self._other_shape, range(len(terms))))
        return tuple(
            (*terms[:i], other, *terms[i + 1 :]) for i, other in every if other is not None
        )

    def _other_shape(self, i: int) -> Candidate | None:
        """The best other shape of a term; None if none is nearly as good."""
        terms, term, at = self.terms, self.terms[i], self.evidence.at
        if term.effect is None or term.unexplained:
            return None
        rest = (*terms[:i], *terms[i + 1 :])
        others = [
            replace(candidate, again=term.again)
            for other in term.effect.refinements(at)
            if not other.missing(at) and not _reached(term.effect, other)
            for candidate in subsets(other)
            if candidate.location == term.location and candidate.sought
        ]
        others = [c for c in others if not any(c.same_cause(m) for m in rest)]
        if not others:
            return None
        about = Shapes.of(beside(self.evidence, rest))
        gains = gains_of(about, others)
        best = _middle_of_the_best(gains)
        return others[best] if gains[best] > NEARLY * gain_of(about, term) else None

    @cached_property
    def at_strongest_place(self) -> tuple[tuple[Candidate, ...], ...]:
        """Sets of terms in which one acts at its strongest joint only, if that is nearly as good.

        In the coarse shapes of the search, values of the other joints made up for the shape.
        """
        terms = self.terms
        every = enumerate(mapped(self._strongest_place, range(len(terms))))
        return tuple(
            (*terms[:i], alone, *terms[i + 1 :]) for i, alone in every if alone is not None
        )

    def _strongest_place(self, i: int) -> Candidate | None:
        """A term of all joints at one of them, in its own shape; None if that is far worse."""
        terms, term = self.terms, self.terms[i]
        if term.effect is None or term.unexplained or term.location is not None:
            return None
        places = [replace(c, again=term.again) for c in subsets(term.effect) if c.location]
        if not places:
            return None
        about = Shapes.of(beside(self.evidence, (*terms[:i], *terms[i + 1 :])))
        gains = gains_of(about, places)
        best = int(np.argmax(gains))
        return places[best] if gains[best] > NEARLY * gain_of(about, term) else None

    def sharpened(self) -> tuple[Candidate, ...]:
        """The terms with their searched fields refined between the grid points of the search."""
        terms = self.terms
        for i, term in enumerate(terms):
            rest = terms[:i] + terms[i + 1 :]
            sharper = in_best_shape(beside(self.evidence, rest), term)
            terms = (*terms[:i], sharper, *terms[i + 1 :])
        return terms


def theta_layout(bare: Layout, terms: Sequence[Candidate]) -> Layout:
    """Layout of theta with these terms: each is an effect, empty if it is a dimension.

    Args:
        bare: layout of the problem without effects.
        terms: the terms in the order of their effects in the chain.
    """
    sizes = [(m.cause, 0 if m.effect is None else len(m.effect.parameters)) for m in terms]
    return bare.with_effects(sizes)


def without_effects(theta: Array, layout: Layout) -> Array:
    """Theta of this layout with the given geometry and placement, and all effects at zero."""
    base = np.zeros(layout.size)
    base[layout.base] = theta[layout.base]
    return base


def beside(
    evidence: LinearizedModel, terms: Sequence[Candidate], prior: Sequence[Array] = ()
) -> LinearizedModel:
    """The evidence with the columns of some terms added to its nuisance.

    Args:
        evidence: of the samples.
        terms: to add.
        prior: precision of each value of each term, (k,) each; `PRECISION` if not given.
    """
    if not terms:
        return evidence
    columns = all_columns(terms, evidence)
    precision = np.concatenate(prior) if prior else np.full(columns.width, PRECISION)
    return evidence.beside(columns, precision)


def _reached(effect: Effect, other: Effect) -> bool:
    """Whether refining an effect's own shape can reach another shape.

    It can if all fields are equal, except those within its intervals and those that follow from
    its values.
    """
    own, shape = effect.settings, other.settings
    none, unit = (effect.refined(np.full(len(effect.parameters), v)).settings for v in (0.0, 1.0))
    by_values = {name for name in own if none[name] != unit[name]}
    searched = {name for name, _, _ in effect.bounded_intervals()}
    fixed = all(shape[name] == own[name] for name in own if name not in searched | by_values)
    within = (
        low <= getattr(other, name) <= high for name, low, high in effect.bounded_intervals()
    )
    return fixed and all(within)


def in_best_shape(evidence: LinearizedModel, term: Candidate) -> Candidate:
    """The term with its best shape within the intervals, searched one field after the other."""
    intervals = () if term.effect is None else term.effect.bounded_intervals()
    if not intervals:
        return term
    about = Shapes.of(evidence)
    for interval in intervals * len(intervals):  # the best value of each depends on the others
        term = _zoomed(about, term, interval)
    valley = term.effect is not None and term.effect.valley and len(intervals) > 1
    return _followed(about, term) if valley else term


def _followed(about: Shapes, term: Candidate) -> Candidate:
    """The best shape along a common valley of the searched fields, stepping all at once."""
    gain = gain_of(about, term)
    for _ in range(_STEPS):
        tried = _ahead(about, term)
        better = gain_of(about, tried)
        if better <= gain:
            break
        term, gain = tried, better
    return term


def _ahead(about: Shapes, term: Candidate) -> Candidate:
    """One Gauss-Newton step of all searched fields, within their intervals."""
    assert term.effect is not None
    evidence, weighed = about.evidence, about.weighed
    columns = columns_of(term, evidence)
    value = np.linalg.lstsq(evidence.information(columns), columns.T @ weighed, rcond=None)[0]
    shapes = shape_columns(term, evidence, np.asarray(value[:, 0], dtype=float))
    both = np.concatenate([columns, shapes], axis=1)
    step = np.linalg.lstsq(evidence.information(both), both.T @ weighed, rcond=None)[0]
    fields: dict[str, Any] = {}
    for (name, low, high), share in zip(
        term.effect.bounded_intervals(), step[columns.shape[1] :, 0], strict=True
    ):
        to = getattr(term.effect, name) + share * (high - low) / np.sqrt(12)
        fields[name] = float(np.clip(to, low, high))
    effect: Effect = replace(cast(Any, term.effect), **fields)
    return replace(term, effect=effect)


def _zoomed(about: Shapes, term: Candidate, interval: Interval) -> Candidate:
    """The best shape within the interval of one field, by a grid search that zooms in.

    Values at which the effect changes by leaps are tried one by one as well, because a grid steps
    over them.
    """
    name, low, high = interval
    found = _zoomed_between(about, term, name, low, high)
    assert found.effect is not None
    values = found.effect.jumps(name, about.evidence.at)
    values = values[(values > low) & (values < high)]
    if not len(values):
        return found
    each = _with_each(found, name, values)
    top = int(np.argmax(gains_of(about, each)))
    near = values[max(0, top - 1)], values[min(top + 1, len(values) - 1)]
    closer = _zoomed_between(about, found, name, *map(float, near))
    return max((found, each[top], closer), key=lambda shape: gain_of(about, shape))


def _with_each(term: Candidate, name: str, values: Array) -> list[Candidate]:
    """The term with each of these values of a field."""
    fields: list[dict[str, Any]] = [{name: float(value)} for value in values]
    return [replace(term, effect=replace(cast(Any, term.effect), **field)) for field in fields]


def _zoomed_between(
    about: Shapes, term: Candidate, name: str, low: float, high: float
) -> Candidate:
    for _ in range(_ZOOMS):
        values = np.linspace(low, high, _POINTS)
        shapes = _with_each(term, name, values)
        gains = gains_of(about, shapes)
        top = _middle_of_the_best(gains)
        term = shapes[top]
        low, high = values[max(0, top - 1)], values[min(top + 1, _POINTS - 1)]
    best = float(values[top])
    if 0 < top < _POINTS - 1:
        best += float(values[1] - values[0]) * _vertex(*gains[top - 1 : top + 2].tolist())
    field: dict[str, Any] = {name: best}
    effect: Effect = replace(cast(Any, term.effect), **field)
    return replace(term, effect=effect)


def _middle_of_the_best(gains: Array) -> int:
    """Index of the middle of the first run of equally good shapes (moments within one gap)."""
    best = np.append(gains >= gains.max() * (1 - _SAME), False)
    first = int(np.argmax(best))
    return first + int(np.argmin(best[first:]) - 1) // 2


def _vertex(before: float, top: float, after: float) -> float:
    """Vertex of a parabola through three points a unit apart, relative to the middle one.

    At most a unit away: the middle one need not be the highest among points that are alike.
    """
    bend = before - 2 * top + after
    return min(max(0.5 * (before - after) / bend, -1.0), 1.0) if bend < 0 else 0.0


def gain_of(about: Shapes, candidate: Candidate) -> float:
    """Decrease of chi square by a candidate."""
    return float(gains_of(about, [candidate])[0])


def gains_of(about: Shapes, candidates: Sequence[Candidate]) -> Array:
    """Decrease of chi square by each of some candidates, less the cost of its values, (c,).

    The values are the likeliest within their bounds. Their cost is that of their prior: along a
    ridge, as that of a growth and a time constant far beyond the session, chi square hardly
    changes and the values become implausible.
    """
    gains = [np.zeros(0)]
    for _, alike in groupby(candidates, lambda candidate: len(candidate.rows)):
        for some, information, along in about.each(list(alike)):
            value, gain = most_likely_of_each(some, information, along[..., 0])
            gains.append(np.maximum(gain - PRECISION * np.sum(value**2, axis=-1), 0.0))
    return np.concatenate(gains)


def _reshaped(term: Candidate, values: Array) -> Candidate:
    effect = None if term.effect is None else term.effect.refined(values)
    return term if effect is term.effect else replace(term, effect=effect)
