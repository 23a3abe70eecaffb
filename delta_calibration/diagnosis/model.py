"""The kinematic chain with the causes found so far, fitted to poses and paths together."""

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
from delta_calibration.diagnosis.geometry import at_scatter
from delta_calibration.diagnosis.linear_model import Cell, LinearizedModel, gather, on_the_way
from delta_calibration.diagnosis.memo import Memo
from delta_calibration.diagnosis.set_aside import like_neighbours
from delta_calibration.diagnosis.verdict import SessionFacts
from delta_calibration.effects import SPREAD
from delta_calibration.estimation import (
    Near,
    Population,
    Problem,
    offset_is_doubtful,
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
_STILL = 0.5  # converged if no parameter moves by more than this share of its typical size
_SETTLING = 2  # steps at a new offset of the reflector
_ANYWHERE = 100.0  # factor on the prior of the reflector's offset that no longer holds it
_LITTLE = 0.1  # predicted decrease of chi square that is not worth a step


@dataclass(frozen=True)
class Model(Fitted):
    """A fit of geometry, frame and the terms found so far, the point of linearisation."""

    survey: Survey
    problem: Problem  # of the poses, its chain without effects
    cell: Cell
    theta: Array  # (P,) of the chain with the terms' effects
    terms: tuple[Candidate, ...] = ()
    near: Array | None = None  # (n, k) approximate poses of the platform
    seen: LinearizedModel | None = None  # the evidence, if it is already known
    scatter: float = 1.0  # of the dimensions, in tolerances
    memo: Memo = field(default_factory=Memo, init=False, repr=False, compare=False)

    def gathered(self) -> LinearizedModel:
        """The evidence of poses and paths."""
        if self.seen is not None:
            return self.seen
        seen = gather(self.survey, self.extended, self.theta, self.cell, self.near)
        return seen if self.scatter == 1.0 else at_scatter(seen, self.scatter)

    @property
    def population(self) -> Population | None:
        """Statistics of the machines of its type, if known."""
        return self.cell.population

    @property
    def noise_degrees(self) -> float:
        """Degrees of freedom of the noise estimate; infinite if the robot file states it."""
        if self.noise_apart:
            return self.cell.noise_degrees
        return self.memo.of("noise_degrees", self._degrees_of_poses)

    def _degrees_of_poses(self) -> float:
        """Degrees of freedom of the poses' residuals, which the noise follows from."""
        return self.evidence.take(np.arange(self.evidence.poses)).degrees

    @property
    def noise_apart(self) -> bool:
        """Whether the noise is known from repeated poses or as the robot file states it."""
        return self.cell.noise.raised == 1.0

    @property
    def floor(self) -> float:
        """Noise of a pose: root mean square of its 3-D error [m]."""
        return self.cell.noise.floor

    def fitted(self, terms: tuple[Candidate, ...]) -> Model:
        """The model fitted with these terms instead of its own."""
        return fit(self, terms)

    @property
    def facts(self) -> SessionFacts:
        """Extent of the session, and how many of its readings took no part."""
        poses = self.survey.poses
        aside = {
            "on_the_way": int(poses.count[on_the_way(self.survey)].sum()),
            "unlike_the_model": int(poses.count[self.unlike].sum()),
        }
        rejected = poses.rejected.counts() | aside
        return SessionFacts(poses.readings, len(poses), poses.duration, rejected)

    @property
    def unlike(self) -> NDArray[np.bool_]:
        """Poses that the fit sets aside as gross errors, (n,)."""
        return np.asarray((self.cell.weight == 0) & ~on_the_way(self.survey))

    def loss(self, samples: float) -> float:
        """Chi square, with each pose that the fit sets aside counted as the least gross error.

        A pose is gross from `GROSS` times the noise on, or times the spread if that is larger.
        """
        gross = GROSS**2 * max(1.0, self.misfit)
        return float(samples * self.misfit + gross * np.count_nonzero(self.unlike))

    def elsewhere(self) -> tuple[Model, ...]:
        """The fit with the reflector's offset of the robot file, if a strong cause drew it away.

        If the platform hardly tilts, an offset far from the file's can imitate a cause that is
        not in the model; linearised about such an offset, the cause cannot be recognised.
        """
        return (self._as_filed(),) if self.strayed and self.misfit >= LACKING else ()

    @property
    def strayed(self) -> bool:
        """Whether the reflector's offset is far from that of the robot file."""
        offset, problem = _offset(self), self.problem
        off = (self.theta - problem.theta0)[offset] / np.diag(problem.basis)[offset]
        return bool(np.abs(off).max() >= STRAYED)

    def _as_filed(self) -> Model:
        """The machine fitted again to the poses, with the reflector's offset of the robot file."""
        free = np.ones(len(self.theta), dtype=bool)
        free[_offset(self)] = False
        held = self.problem.only(free)
        solution = solve(held, Near(held.unknowns(self.theta)))
        cell = replace(self.cell, weight=solution.weight)
        return replace(self, theta=solution.theta, cell=cell, near=None, seen=None)

    def on_its_floor(self) -> Model:
        """The machine without terms, at the minimum of the offset that poses and paths favour.

        If the platform hardly tilts, the error of the poses has a second minimum of nearly the
        same depth, with the offset centimetres away or more. The readings in motion decide which
        is right; about the wrong one they would show structure that does not exist. Only for an
        offset that the poses leave in doubt: otherwise they alone decide.
        """
        if not (len(self.survey.paths) and self.misfit < LACKING):
            return self
        filed = self._as_filed()
        return filed if filed.cost_ahead < self.cost_ahead - OTHER_FLOOR else self

    @property
    def cost_ahead(self) -> float:
        """Chi square of readings and priors predicted after one step from here."""
        return self.beside.cost(self.beside.best())

    def quieter(self, found: Fitted) -> Model:
        """The model with the noise estimated again, without what the found causes do to repeats.

        A strong cause changes repeated poses by more than the smooth part that is removed from
        them (`noise.py`); counted as noise, it would hide weaker causes and widen every interval.
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
        return solved(self.survey, replace(self.cell, noise=noise), problem)

    @property
    def most_louder(self) -> float:
        """Largest factor on the noise: 1 if it was measured, else what a few visits allow."""
        noise = self.cell.noise
        return 1.0 if noise.measured else noise.most

    def louder(self, factor: float) -> Model:
        """The fit with its noise times a factor, but no less than the robot file states."""
        noise = self.cell.noise.louder(factor)
        factor = noise.raised / self.cell.noise.raised
        parts = (replace(m, given=m.whiten / factor) for m in self.problem.measured)
        problem = replace(self.problem, measured=tuple(parts))
        return solved(self.survey, replace(self.cell, noise=noise), problem)

    def loosened(self, scatter: float) -> Model:
        """The same fit, with wider priors of the dimensions.

        A dimension held within its tolerance although it exceeds it leaves errors that others, or
        a cause, would be taken for. Itself if the wider ones lead out of reach.
        """
        wider = _joined(replace(self, scatter=scatter, seen=None))
        return wider if np.isfinite(_residual(wider)).all() else self

    def placed_freely(self) -> Model:
        """The fit with a reflector that may sit anywhere on its platform."""
        return self.memo.of("placed_freely", self._placed_freely)

    def _placed_freely(self) -> Model:
        basis = self.problem.basis.copy()
        basis[:, _offset(self)] *= _ANYWHERE
        return _converged(replace(self, problem=replace(self.problem, basis=basis), seen=None))

    def everything(self) -> Model:
        """The same fit, with the poses that it set aside as gross errors in use again."""
        weight = self.cell.weight
        if (weight > 0).all():
            return self
        cell = replace(self.cell, weight=np.where(weight > 0, weight, 1.0))
        return replace(self, cell=cell, seen=None)

    def readmitted(self) -> Model:
        """The same fit, with those poses in use again that it set aside and that miss alike."""
        out = np.flatnonzero(self.unlike)
        missed, joint = _residual(self)[out, :3], self.survey.poses.joint[out]
        alike = out[like_neighbours(missed, joint)]
        if not alike.size:
            return self
        weight = self.cell.weight.copy()
        weight[alike] = 1.0
        return replace(self, cell=replace(self.cell, weight=weight), seen=None)

    def at(self, theta: Array) -> Model:
        """The same model with other parameter values, (P,)."""
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
        """The model converged on poses and paths together."""
        return rested(self)


def solved(survey: Survey, cell: Cell, problem: Problem, near: Near | None = None) -> Model:
    """Identify the geometry from the poses, without effects in the chain.

    Args:
        survey: poses and paths.
        cell: robot, noise and weights; the weights of the poses are determined again.
        problem: that of fitting the poses.
        near: where to start; the problem's own theta if not given.
    """
    solution = solve(problem, near, everywhere=True)
    model = Model(survey, problem, replace(cell, weight=solution.weight), solution.theta)
    return model.on_its_floor() if offset_is_doubtful(solution) else model


@one_thread()
def fit(model: Model, terms: tuple[Candidate, ...]) -> Model:
    """Fit the model with these terms instead of its own.

    First to the poses, with a robust loss; then to poses and paths together, by Gauss-Newton.

    Shapes that depend on the values (the width of a play) are updated during the fit.
    """
    now = _begun(_at_nothing(model, terms))
    cell = replace(now.cell, weight=robust_weights(_residual(now)))
    # before the first cause was known, it may have held the offset in another minimum
    now = _settled(replace(now, cell=cell, terms=now.refined()), not model.terms)
    return _joined(now) if len(model.survey.paths) else now


def _begun(model: Model) -> Model:
    """First step from a model at zero values, with the searched fields at their best.

    Poses that were set aside may be what a strong cause does: the fields are also sought with
    those in use that miss alike.
    """
    begun = _stepped(_sharpened(model))
    readmitted = model.readmitted()
    if readmitted is model or begun.terms is model.terms:
        return begun
    return min(begun, _stepped(_sharpened(readmitted)), key=_left)


def _left(model: Model) -> float:
    """Chi square of the poses, each limited to that of the smallest gross error."""
    return float(np.minimum(np.sum(_residual(model) ** 2, axis=1), GROSS**2).sum())


def _at_nothing(model: Model, terms: tuple[Candidate, ...]) -> Model:
    """The model with these terms instead of its own, all their values at zero.

    The evidence about it does not depend on the shapes of the terms and is gathered once.
    """
    theta = without_effects(model.theta, theta_layout(model.problem.layout, terms))
    now = replace(model, terms=terms, theta=theta, near=model.evidence.pose, seen=None)
    return replace(now, seen=now.evidence if model.terms else model.evidence)


def _joined(model: Model) -> Model:
    """The model converged on poses and paths together, starting from its fit to the poses.

    The reflector's offset is held at its fit to the poses: all else is then nearly linear.
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
    """The model with all parameters and searched fields fitted to poses and paths."""
    if not len(model.survey.paths) and all(term.plain for term in model.terms):
        return model  # converged on the poses, in its only shape
    return _converged(model)


def _converged(model: Model) -> Model:
    """The model after steps in all parameters and searched fields, while these lower its cost.

    A step in all parameters leads along the curved valley of the reflector's offset and off its
    floor; the steps after it, with that offset held, lead back. Searched fields are refined before
    each step: their best values depend on the others.
    """
    misfit = model.misfit
    cost = _cost(model, misfit)
    for _ in range(_ROUNDS):
        now = replace(_sharpened(model), seen=model.evidence)
        if cost - now.beside.cost(now.beside.best(misfit), misfit) < _LITTLE:
            break
        tried = _moved(now)
        for _ in range(_SETTLING):
            tried = _moved(tried, _offset(tried))
        lower = _cost(tried, misfit)
        if not lower < cost:
            break
        model, cost = tried, lower
    return model


def _cost(model: Model, misfit: float) -> float:
    """Cost that the fit minimises: chi square of readings and priors."""
    problem, base = model.extended, model.layout.base
    own = np.linalg.solve(problem.basis, model.theta - problem.theta0)[base]
    parts = []
    for term in model.terms:
        if term.effect is None:
            rows = list(term.rows)
            excess = own[rows] / (1 + (model.scatter / SPREAD) ** 2)
            parts.append(excess)
            own[rows] -= excess
        else:
            parts.append(model.values(term) / typical_of(term))
    return model.beside.cost(np.concatenate([own, *parts]), misfit)


def _offset(model: Model) -> Index:
    """Entries of theta that are the reflector's offset."""
    return entries(model.layout.offset)


def _settled(model: Model, everywhere: bool) -> Model:
    """The model converged on the poses; parameters that show only in motion are held.

    If the platform hardly tilts, the reflector's offset lies in a curved valley: linear steps end
    beside its floor. The iterative fit follows the valley.
    """
    problem, free = model.extended, np.ones(len(model.theta), dtype=bool)
    basis = problem.basis.copy()
    basis[model.layout.geometry] *= model.scatter
    for term, own in zip(model.terms, model.layout.each, strict=True):
        if term.effect is None:  # it has an excess beside the deviation of all dimensions
            basis[list(term.rows)] *= np.sqrt(1 + (SPREAD / model.scatter) ** 2)
            continue
        free[own] = False
        free[entries(own)[list(term.rows)]] = _shows_at_rest(model, term)
    held = np.where(free, problem.theta0, model.theta)
    start = replace(problem, theta0=held, basis=basis).only(free)
    solution = solve(start, Near(start.unknowns(model.theta)), everywhere=everywhere)
    cell = replace(model.cell, weight=solution.weight)
    return replace(model, theta=solution.theta, cell=cell, near=None, seen=None)


def _shows_at_rest(model: Model, term: Candidate) -> NDArray[np.bool_]:
    """Whether the poses carry a fair share of the information on each value of a term, (k,)."""
    if not len(model.survey.paths):
        return np.ones(len(term.rows), dtype=bool)
    evidence = model.evidence
    whole = np.diag(evidence.information_of(products_of(term, evidence)))
    resting = evidence.take(np.arange(evidence.poses))
    alone = np.diag(resting.information_of(products_of(term, resting)))
    return np.asarray(alone > FAIR * whole)


def _moved(model: Model, held: Index = _NOTHING) -> Model:
    """The model after one step, with shapes updated to the new values."""
    step = _stepped(model, held)
    return replace(step, terms=step.refined())


def _stepped(model: Model, held: Index = _NOTHING) -> Model:
    """The model after one Gauss-Newton step of geometry, frame and terms; `held` entries fixed."""
    theta = model.ahead(model.misfit, held)
    return replace(model, theta=theta, near=model.evidence.pose, seen=None)


def _sharpened(model: Model) -> Model:
    """The model with searched fields of its terms refined between the points of the search."""
    terms = model.sharpened()
    changed = any(new is not old for new, old in zip(terms, model.terms, strict=True))
    return replace(model, terms=terms) if changed else model


def _residual(model: Model) -> Array:
    """Whitened residuals of the poses, none set aside, (n, d)."""
    problem = model.extended
    return problem.linearized(model.theta).residual
