"""The chain with what was found in it, fitted to poses and paths together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Survey
from delta_calibration.diagnosis.candidates import Candidate, products_of, typical_of
from delta_calibration.diagnosis.constants import (
    FAIR,
    GROSS,
    LACKING,
    OTHER_FLOOR,
    QUIETER,
    STRAYED,
)
from delta_calibration.diagnosis.fitted import Fitted, theta_layout, without_effects
from delta_calibration.diagnosis.linear_model import Cell, LinearizedModel, gather, on_the_way
from delta_calibration.diagnosis.memo import Memo
from delta_calibration.diagnosis.verdict import SessionFacts
from delta_calibration.estimation import (
    Population,
    Problem,
    prepare,
    robust_weights,
    solve,
    with_turns,
)
from delta_calibration.theta import entries
from delta_calibration.threads import one_thread

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ROUNDS = 4
_NOTHING = np.zeros(0, dtype=np.int64)
_STILL = 0.5  # of their typical sizes by which no parameter moves any more
_SETTLING = 2  # steps at a new offset of the reflector
_LITTLE = 0.1  # decrease of chi square ahead that is not worth a step


@dataclass(frozen=True)
class Model(Fitted):
    """A fit: geometry, frame and the terms found so far, about which all is linear."""

    survey: Survey
    problem: Problem  # of the poses, its chain without effects
    cell: Cell
    theta: Array  # (P,) of the chain with the terms' effects
    terms: tuple[Candidate, ...] = ()
    near: Array | None = None  # (n, k) poses of the platform, nearly
    seen: LinearizedModel | None = None  # the evidence, where it is known beforehand
    memo: Memo = field(default_factory=Memo, init=False, repr=False, compare=False)

    def gathered(self) -> LinearizedModel:
        """The evidence, of poses and paths."""
        if self.seen is not None:
            return self.seen
        return gather(self.survey, self.extended, self.theta, self.cell, self.near)

    @property
    def population(self) -> Population | None:
        """Of the machines of its type, where it is known."""
        return self.cell.population

    @property
    def noise_degrees(self) -> float:
        """Degrees of freedom of the noise estimate; infinite where the robot's file states it."""
        return self.cell.noise_degrees

    @property
    def noise_apart(self) -> bool:
        """By repeats, or by the robot's file."""
        return True

    @property
    def floor(self) -> float:
        """Root mean square of what noise makes of a pose [m]."""
        return self.cell.noise.floor

    def fitted(self, terms: tuple[Candidate, ...]) -> Model:
        """The model with these terms instead."""
        return fit(self, terms)

    @property
    def facts(self) -> SessionFacts:
        """What was measured, and how much of it took no part."""
        poses, passing = self.survey.poses, on_the_way(self.survey)
        unlike = (self.cell.weight == 0) & ~passing
        aside = {
            "on_the_way": int(poses.count[passing].sum()),
            "unlike_the_model": int(poses.count[unlike].sum()),
        }
        rejected = poses.rejected.counts() | aside
        return SessionFacts(poses.readings, len(poses), poses.duration, rejected)

    def elsewhere(self) -> tuple[Model, ...]:
        """The machine with its reflector where the file has it, if a strong cause drew it away.

        Where the platform hardly tilts, an offset far off is a cheap way to follow a cause that
        is not in the model; about it nothing is linear that would name the cause.
        """
        return (self._as_filed(),) if self.strayed and self.misfit >= LACKING else ()

    @property
    def strayed(self) -> bool:
        """Whether the reflector is far from where the file has it."""
        offset, problem = _offset(self), self.problem
        off = (self.theta - problem.theta0)[offset] / np.diag(problem.basis)[offset]
        return bool(np.abs(off).max() >= STRAYED)

    def _as_filed(self) -> Model:
        """The machine fitted anew to the poses with its reflector where the file has it."""
        free = np.ones(len(self.theta), dtype=bool)
        free[_offset(self)] = False
        held = self.problem.only(free)
        solution = solve(held, held.unknowns(self.theta))
        cell = replace(self.cell, weight=solution.weight)
        return replace(self, theta=solution.theta, cell=cell, near=None, seen=None)

    def on_its_floor(self) -> Model:
        """The machine without terms, its reflector where poses and paths together have it.

        Where the platform hardly tilts, an offset has a second floor of nearly the same error on
        the poses, centimetres off or more. The readings in motion tell which is the right one;
        about the wrong one they would show structure that is none.
        """
        if not (len(self.survey.paths) and self.misfit < LACKING):
            return self
        filed = self._as_filed()
        return filed if filed.cost_ahead < self.cost_ahead - OTHER_FLOOR else self

    @property
    def cost_ahead(self) -> float:
        """Chi square of readings and priors that a step from here promises."""
        return self.beside.cost(self.beside.best())

    def quieter(self, found: Fitted) -> Model:
        """Itself with the noise that repeats have without what the causes found do to them.

        A strong cause does more between two visits of a place than goes off with what is smooth
        (`noise.py`); counted as noise, it would hide weaker ones and widen every interval.
        """
        assert isinstance(found, Model)
        moved = found.moved_by_causes()
        if not moved.any():
            return self
        poses, robot = self.survey.poses, self.cell.robot
        _, noise, problem = prepare(poses, robot, self.problem.chain, moved)
        problem = with_turns(problem, poses, robot, noise)
        if noise.floor > QUIETER * self.floor:
            return self
        problem = replace(self.problem, measured=problem.measured)
        quiet = solved(self.survey, replace(self.cell, noise=noise), problem)
        explained = np.maximum(quiet.cell.weight, found.cell.weight)  # no gross errors
        return replace(quiet, cell=replace(quiet.cell, weight=explained), seen=None)

    def everything(self) -> Model:
        """The same fit, with poses that it set aside as gross errors to be looked at again."""
        weight = self.cell.weight
        if (weight > 0).all():
            return self
        cell = replace(self.cell, weight=np.where(weight > 0, weight, 1.0))
        return replace(self, cell=cell, seen=None)

    def at(self, theta: Array) -> Model:
        """The same with other values, (P,)."""
        return replace(self, theta=theta, near=None, seen=None)

    def moved_by_causes(self) -> Array:
        """How far the named effects move each pose's reading, (n, 3) [m]."""
        chain, layout, without = self.extended.chain, self.layout, self.theta.copy()
        for term, own in zip(self.terms, layout.each, strict=True):
            if not term.unexplained:
                without[own] = 0.0
        at, without = self.extended.at, without[layout.chain]
        return np.asarray(chain.predict(at, self.chain_theta) - chain.predict(at, without))

    def rested(self) -> Model:
        """The model at rest on poses and paths together."""
        return rested(self)


def solved(survey: Survey, cell: Cell, problem: Problem, near: Array | None = None) -> Model:
    """The geometry identified by the poses, with nothing else in the chain.

    Args:
        survey: poses and paths.
        cell: what is known beside them; the weights of the poses are found anew.
        problem: of fitting the poses.
        near: unknowns to start from, (F,); the problem's own theta where not given.
    """
    solution = solve(problem, near, everywhere=True)
    model = Model(survey, problem, replace(cell, weight=solution.weight), solution.theta)
    return model.on_its_floor()


@one_thread()
def fit(model: Model, terms: tuple[Candidate, ...]) -> Model:
    """The model with these terms instead, fitted by Gauss-Newton with robust weights.

    Shapes that go with values (the width of a play) are set to them on the way.
    """
    now = _begun(_at_nothing(model, terms))
    cell = replace(now.cell, weight=robust_weights(_residual(now)))
    # the first cause that comes in may have held the offset on another floor of its valley
    now = _settled(replace(now, cell=cell, terms=now.refined()), not model.terms)
    return _joined(now) if len(model.survey.paths) else now


def _begun(model: Model) -> Model:
    """A first step, searched fields of the shapes where they do most.

    Poses that were set aside may be what a strong cause does: a moment is sought with them, too.
    """
    begun = _stepped(_sharpened(model))
    everything = model.everything()
    if everything is model or begun.terms is model.terms:
        return begun
    return min(begun, _stepped(_sharpened(everything)), key=_left)


def _left(model: Model) -> float:
    """Chi square of the poses, each of gross errors counted as the least such."""
    return float(np.minimum(np.sum(_residual(model) ** 2, axis=1), GROSS**2).sum())


def _at_nothing(model: Model, terms: tuple[Candidate, ...]) -> Model:
    """The model with these terms in the place of its own, all their values at zero.

    In what shapes they are does not matter to the evidence about it, which is gathered once.
    """
    theta = without_effects(model.theta, theta_layout(model.problem.layout, terms))
    now = replace(model, terms=terms, theta=theta, near=model.evidence.pose, seen=None)
    return replace(now, seen=now.evidence if model.terms else model.evidence)


def _joined(model: Model) -> Model:
    """The model at rest on poses and paths together, from where it rests on the poses.

    The reflector's offset stays where the poses have it: with it, all else is nearly linear.
    """
    offset = _offset(model)
    for _ in range(_ROUNDS):
        step = _moved(model, offset)
        moved = np.abs(step.theta - model.theta) / np.diag(model.extended.basis)
        model = step
        if moved.max() < _STILL:
            break
    return model


def rested(model: Model) -> Model:
    """The model with the reflector's offset, too, where poses and paths together have it.

    A step in everything leads along the offset's curved valley and off its floor; the steps after
    it, at that offset, lead back. All is kept as long as it is more likely than before.
    """
    if not len(model.survey.paths):
        return model
    misfit = model.misfit
    cost = _cost(model, misfit)
    for _ in range(_ROUNDS):
        if cost - model.beside.cost(model.beside.best(misfit), misfit) < _LITTLE:
            break
        tried = _moved(model)
        for _ in range(_SETTLING):
            tried = _moved(tried, _offset(tried))
        lower = _cost(tried, misfit)
        if not lower < cost:
            break
        model, cost = tried, lower
    return model


def _cost(model: Model, misfit: float) -> float:
    """What the fit makes least: chi square of readings and priors."""
    problem, base = model.extended, model.layout.base
    own = np.linalg.solve(problem.basis, model.theta - problem.theta0)[base]
    parts = []
    for term in model.terms:
        if term.effect is None:
            rows = list(term.rows)
            parts.append(own[rows])
            own[rows] = 0.0
        else:
            parts.append(model.values(term) / typical_of(term))
    return model.beside.cost(np.concatenate([own, *parts]), misfit)


def _offset(model: Model) -> Index:
    """Entries of the reflector's offset."""
    return entries(model.layout.offset)


def _settled(model: Model, everywhere: bool) -> Model:
    """The model at rest on the poses, what shows in motion only held where it is.

    Where the platform hardly tilts, the reflector's offset lies in a curved valley: steps that
    take everything for linear end beside its floor. The search of the fit follows it.
    """
    problem, free = model.extended, np.ones(len(model.theta), dtype=bool)
    for term, own in zip(model.terms, model.layout.each, strict=True):
        if term.effect is None:
            continue
        free[own] = False
        free[entries(own)[list(term.rows)]] = _shows_at_rest(model, term)
    held = np.where(free, problem.theta0, model.theta)
    start = replace(problem, theta0=held).only(free)
    solution = solve(start, start.unknowns(model.theta), everywhere=everywhere)
    cell = replace(model.cell, weight=solution.weight)
    return replace(model, theta=solution.theta, cell=cell, near=None, seen=None)


def _shows_at_rest(model: Model, term: Candidate) -> NDArray[np.bool_]:
    """Whether the poses hold a fair part of what is known of each parameter of a term, (k,)."""
    if not len(model.survey.paths):
        return np.ones(len(term.rows), dtype=bool)
    evidence = model.evidence
    whole = np.diag(evidence.information_of(products_of(term, evidence)))
    resting = evidence.take(np.arange(evidence.poses))
    alone = np.diag(resting.information_of(products_of(term, resting)))
    return np.asarray(alone > FAIR * whole)


def _moved(model: Model, held: Index = _NOTHING) -> Model:
    """One step, and the shapes that go with its values."""
    step = _stepped(model, held)
    return replace(step, terms=step.refined())


def _stepped(model: Model, held: Index = _NOTHING) -> Model:
    """One Gauss-Newton step of geometry, frame and terms; some of the base's unknowns held."""
    theta = model.ahead(model.misfit, held)
    return replace(model, theta=theta, near=model.evidence.pose, seen=None)


def _sharpened(model: Model) -> Model:
    """The model with searched fields of its terms between the points of the search."""
    terms = model.sharpened()
    changed = any(new is not old for new, old in zip(terms, model.terms, strict=True))
    return replace(model, terms=terms) if changed else model


def _residual(model: Model) -> Array:
    """Whitened residuals of the poses, none set aside, (n, d)."""
    problem = model.extended
    return problem.linearized(model.theta).residual
