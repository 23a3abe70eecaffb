"""Identify the parameters of a machine from measured poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.data import Poses, require_poses
from delta_calibration.errors import DataError, SingularityError
from delta_calibration.estimation.carried import Carried
from delta_calibration.estimation.cross_validation import Known
from delta_calibration.estimation.measurements import Measured, PointMeasured
from delta_calibration.estimation.method import Fit, LeastSquares, Method, Watch
from delta_calibration.estimation.noise import Noise, estimate_noise, whitening
from delta_calibration.estimation.observability import (
    Observability,
    observe,
    strong_correlations,
)
from delta_calibration.estimation.population import Population, carried_by
from delta_calibration.estimation.positions import Rest, uncertainty_of
from delta_calibration.estimation.problem import Near, Problem, build_problem
from delta_calibration.estimation.registration import registered
from delta_calibration.estimation.residuals import (
    FOLDS,
    Residuals,
    chi_squares,
    figures_of,
    held_out,
    known_of,
    only,
    parts_of,
    studentized_of,
    turn_missed,
)
from delta_calibration.estimation.same_robot import FEWEST, require_this_robot
from delta_calibration.estimation.solver import Solution, solve
from delta_calibration.estimation.turns import with_turns
from delta_calibration.geometry import Frame, align
from delta_calibration.parameters import ParameterSet
from delta_calibration.region import Region
from delta_calibration.robot import Robot
from delta_calibration.threads import one_thread
from delta_calibration.uncertainty import Uncertainty

Array = NDArray[np.float64]

_FEWEST_OF_MANY = 6  # different places, with a population prior
FEWEST_CARRIED = 5  # places of a known machine: they fix the tracker frame and show a change
PRIOR_HISTORY, PRIOR_POPULATION = "history", "population"  # origin of a fit's prior
_LOOSE = 1.0  # [m] motion of the platform by tolerances, from which a pose counts as singular
_BEYOND = 5.0  # tolerances: a normal distribution exceeds them once in two million times
_LEAST_SQUARES = LeastSquares()


@dataclass(frozen=True)
class Effort:
    """Method of a fit, its settings and the number of its evaluations."""

    method: str
    # evaluations of the fit, without those of the held-out fits; None if not counted
    evaluations: int | None = None
    settings: Mapping[str, int | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Identification:
    """Result of a fit: the identified chain and the figures needed to assess it."""

    chain: Chain
    theta: Array  # (P,)
    covariance: Array  # (P, P)
    noise: Noise
    observability: Observability
    correlations: tuple[tuple[str, str, float], ...]
    frame_only: Residuals
    full: Residuals
    frame_only_theta: Array  # (P,) nominal geometry in its best-fit frame: `registration.py`
    weight: Array  # (n,) of each pose under the robust loss
    chi_square: float  # per degree of freedom, of the whitened residuals
    region: Region
    region_joints: tuple[Array, Array]  # lowest and highest joint angles measured, (m,) [rad]
    seed: int
    effort: Effort
    # held-out residuals, (n, 3) [m] measured less predicted in the tracker's frame; NaN for
    # rejected poses
    missed_before: Array
    missed: Array
    uncertainty: Uncertainty  # of predicted positions
    # RMS angle of the orientation residual [rad]; None: orientations were not fitted
    turn_missed: float | None = None
    unseen_motion: float = 0.0  # [m] see Poses.unseen_motion

    @property
    def parameters(self) -> ParameterSet:
        """Parameters of the chain."""
        return self.chain.parameters

    @property
    def std(self) -> Array:
        """Standard errors, (P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def frame(self) -> Frame:
        """`T_tracker_base`, fitted together with the geometry."""
        return self.chain.split(self.theta)[2]


def chain_of(robot: Robot, model: str | None = None) -> Chain:
    """Return the chain of a robot's cell, with the mechanism of its file or another one."""
    tracker = robot.tracker
    return Chain(robot.model(model), tracker.reflector_offset, tracker.reflector_offset_prior)


def most_evaluations(method: Method, robot: Robot, model: str | None = None) -> int:
    """Largest number of evaluations `identify` reports to `watch`, held-out fits included."""
    layout = chain_of(robot, model).layout
    if robot.tracker.turn is not None:  # if orientations are fitted
        layout = layout.mounted
    return (1 + FOLDS) * method.most(layout.size)


@one_thread()
def identify(
    poses: Poses,
    robot: Robot,
    model: str | None = None,
    seed: int = 0,
    method: Method = _LEAST_SQUARES,
    watch: Watch = lambda _: None,
    carried: Carried | None = None,
    population: Population | None = None,
) -> Identification:
    """Fit geometry (with priors: MAP), reflector offset and tracker frame to measured poses.

    Orientations are fitted as well if the session has them, the robot file states their noise and
    the model's platform rotates. Held-out errors are those of positions.

    Args:
        poses: the measured poses.
        robot: drawing, priors, tracker.
        model: name of a mechanism; by default that of the robot file.
        seed: of the division into held-out parts, and of a method's random numbers.
        method: solver of the estimation problem.
        watch: called with the number of new evaluations while a slow method runs.
        carried: prior of the machine by earlier sessions, in place of its tolerances; its effects
            are fitted, too.
        population: prior by machines of this type, in place of the tolerances; the effects that
            most of them have are fitted, too.

    Raises:
        DataError: too few different poses, poses out of the nominal robot's reach or at a
            singularity, residuals that no manufacturing error explains (another robot), or a
            method that does not converge.
    """
    require_poses(poses, _fewest(carried, population))
    chain = chain_of(robot, model)
    if population is not None:
        population = population.shown_by(poses.conditions)
        chain = chain.with_effects(population.effects)
    if carried is not None:
        chain = chain.with_effects(carried.effects)
    _, noise, drawn = prepare(poses, robot, chain)
    drawn = with_turns(drawn, poses, robot, noise)
    before = registered(drawn)
    require_this_robot(drawn, poses, robot)
    problem, near = _believed(drawn, carried, population)
    prior = told_by(carried, population)
    rng = np.random.default_rng([seed, 1])
    fit = method.fit(problem, rng, watch, near)
    if not prior and isinstance(method, LeastSquares):
        fit = _freed(fit)
    full = fit.solution
    folds, counted = parts_of(poses, seed), full.weight > 0
    known = known_of(full)
    used = float(np.trace(np.linalg.solve(known.whole, known.information)))
    chi_square, spread = chi_squares(full, poses.place, used)
    covariance = _covariance(full, known, spread)
    _require_bounded(covariance, poses, robot)
    observability = _observability(drawn, full.theta)
    visited = poses.joint
    if carried is not None:
        visited = np.concatenate([visited, carried.joint])
    nominal = chain.mechanism.forward(visited, chain.mechanism.parameters.nominal)
    missed_before = held_out(before, folds, _LEAST_SQUARES, rng, watch)
    missed = held_out(full, folds, method, rng, watch)
    theta = full.theta[full.problem.layout.chain]
    return Identification(
        chain=chain,
        theta=theta,
        covariance=covariance,
        noise=noise,
        observability=observability,
        correlations=strong_correlations(covariance, chain.parameters.names),
        frame_only=figures_of(before, missed_before, counted),
        full=figures_of(full, missed, counted),
        frame_only_theta=before.theta[before.problem.layout.chain],
        weight=full.weight,
        chi_square=chi_square,
        region=Region.of(chain.mechanism.position(nominal)),
        region_joints=(visited.min(axis=0), visited.max(axis=0)),
        seed=seed,
        effort=Effort(method.name, fit.evaluations, {**method.settings, **prior}),
        missed_before=only(missed_before, counted),
        missed=only(missed, counted),
        uncertainty=uncertainty_of(
            chain,
            theta,
            covariance,
            Rest(noise.repeatability, noise.freedom),
            studentized_of(full, known, poses.place),
        ),
        turn_missed=turn_missed(full),
        unseen_motion=poses.unseen_motion,
    )


def _believed(
    drawn: Problem, carried: Carried | None, population: Population | None
) -> tuple[Problem, Near | None]:
    """The problem with its prior in place of the tolerances, and where to start from."""
    problem = drawn if carried is None else carried.applied(drawn)
    if population is None:
        return problem, None
    plain = solve(problem)
    problem = carried_by(plain, population).applied(drawn)
    # start: its residuals show the noise, not the prior
    return problem, Near(problem.unknowns(plain.theta))


def _covariance(solution: Solution, known: Known, spread: float) -> Array:
    """Covariance of the chain's parameters, (P, P)."""
    basis = solution.problem.basis[solution.problem.layout.chain]
    return np.asarray(basis @ known.covariance(spread) @ basis.T)


def _require_bounded(covariance: Array, poses: Poses, robot: Robot) -> None:
    """Refuse an uncertainty that is not a finite number."""
    variance = np.diag(covariance)
    if not ((variance >= 0.0) & (variance < np.inf)).all():
        raise SingularityError(
            f"{poses.source}: the uncertainty of robot {robot.name!r} is unbounded: is the "
            "nominal robot singular at the measured poses?"
        )


def _observability(drawn: Problem, theta: Array) -> Observability:
    """Observability at the drawing, in the frame that was fitted."""
    chain, layout, drawing = drawn.chain, drawn.layout, theta.copy()
    nominal = chain.mechanism.parameters.nominal
    drawing[layout.chain] = chain.join(nominal, chain.offset, chain.split(theta)[2])
    about = replace(drawn, basis=np.eye(layout.size)).linearized(drawing)
    return observe(about.slope, np.diag(drawn.basis), drawn.names)


def _freed(fit: Fit) -> Fit:
    """The fit repeated with wider priors of those dimensions that are far off their drawing.

    A tolerance that a dimension exceeds so far does not hold for it, and would pull it back by
    more than its interval.
    """
    problem, theta = fit.solution.problem, fit.solution.theta
    geometry, basis = problem.layout.geometry, problem.basis.copy()
    off = np.abs(theta - problem.theta0)[geometry] / np.diag(basis)[geometry]
    far = (off >= _BEYOND) & problem.has_prior[geometry].astype(bool)
    if not far.any():
        return fit
    basis[:, geometry] *= np.where(far, off, 1.0)
    wider = replace(problem, basis=basis)
    again = solve(wider, Near(wider.unknowns(theta)))
    return Fit(again, fit.evaluations + again.evaluations)


def told_by(
    carried: Carried | None = None, population: Population | None = None
) -> dict[str, int | str]:
    """Settings entry that names a fit's prior: such a fit is no independent evidence of it."""
    if carried is not None:
        return {"prior": PRIOR_HISTORY}
    return {} if population is None else {"prior": PRIOR_POPULATION}


def _fewest(carried: Carried | None, population: Population | None) -> int:
    """Least number of different places for a fit, by the kind of its prior."""
    if carried is not None:
        return FEWEST_CARRIED
    return FEWEST if population is None else _FEWEST_OF_MANY


def prepare(
    poses: Poses, robot: Robot, chain: Chain, explained: Array | float = 0.0
) -> tuple[Array, Noise, Problem]:
    """Return theta of the nominal chain in its best frame, the noise and the whitened problem.

    Args:
        poses: the measured poses.
        robot: drawing, tracker, repeatability.
        chain: nominal.
        explained: displacement of each pose by known causes, which is no noise between its
            repeats, (n, 3) [m] in the tracker's frame.

    Raises:
        DataError: a pose that the nominal robot cannot reach or at which it is singular, or poses
            on one line.
    """
    nominal = chain.mechanism.parameters.nominal
    x = chain.mechanism.forward(poses.joint, nominal)
    what = f"{poses.source}: recorded joint command"
    chain.mechanism.require_reach(x, poses.joint, what)
    _require_held(chain, poses, x)
    try:
        frame = align(chain.point(x, chain.offset), poses.point)
    except DataError as error:
        raise DataError(f"{poses.source}: {error}") from error
    start = chain.join(nominal, chain.offset, frame)
    slope = chain.see(poses.conditions, start, x).by_joints
    unexplained = replace(poses, point=poses.point - explained)
    noise = estimate_noise(unexplained, slope, robot)
    whiten = whitening(noise.covariance(poses, slope, robot.tracker))
    seen = PointMeasured(poses.joint, poses.point, None, noise.floor)
    measured = Measured(seen, poses.conditions, given=whiten)
    return start, noise, build_problem(chain, measured, start)


def _require_held(chain: Chain, poses: Poses, x: Array) -> None:
    """Refuse poses at which the nominal robot's platform is free to move (parallel singularity).

    There the effect of a geometric error is undefined. At serial singularities, where a joint has
    no effect (a stretched arm), it is defined.
    """
    mechanism = chain.mechanism
    parameters = mechanism.parameters
    slope = mechanism.identification_jacobian(poses.joint, x, parameters.nominal)
    known = np.isfinite(parameters.prior)
    moved = np.linalg.norm(slope[..., known] * parameters.prior[known], axis=(1, 2))
    bad = np.flatnonzero(~(moved < _LOOSE))
    if bad.size:
        raise SingularityError(
            f"{poses.source}: pose {bad[0] + 1} is singular: tolerances of the parts move the "
            f"nominal platform by {moved[bad[0]]:.2g} m; under {_LOOSE:g} m is allowed"
        )
