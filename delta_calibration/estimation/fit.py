"""Identify the parameters of a machine from measured poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.data import Poses, require_poses
from delta_calibration.effects import Stage, catalogue
from delta_calibration.errors import DataError, SingularityError
from delta_calibration.estimation.carried import Carried
from delta_calibration.estimation.cross_validation import Known, studentized
from delta_calibration.estimation.measurements import Measured, PointMeasured
from delta_calibration.estimation.method import Fit, LeastSquares, Method, Watch
from delta_calibration.estimation.noise import Noise, estimate_noise, whitening
from delta_calibration.estimation.observability import (
    Observability,
    observe,
    strong_correlations,
)
from delta_calibration.estimation.population import Population, carried_by
from delta_calibration.estimation.positions import Missed, Rest, uncertainty_of
from delta_calibration.estimation.problem import Near, Problem, Solution, build_problem, solve
from delta_calibration.estimation.registration import registered
from delta_calibration.estimation.turns import with_turns
from delta_calibration.geometry import Frame, align
from delta_calibration.parameters import ParameterSet
from delta_calibration.region import Region
from delta_calibration.robot import Robot
from delta_calibration.threads import one_thread
from delta_calibration.uncertainty import Uncertainty

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_FEWEST = 12  # different places; fewer cannot determine a model of two dozen parameters
_FEWEST_OF_MANY = 6  # different places, with a population prior
FEWEST_CARRIED = 5  # places of a known machine: they fix the tracker frame and show a change
PRIOR_HISTORY, PRIOR_POPULATION = "history", "population"  # origin of a fit's prior
_FOLDS = 5
_LOOSE = 1.0  # [m] motion of the platform by tolerances, from which a pose counts as singular
_ANOTHER_ROBOT = 4.0  # residual over what tolerances explain: too large for manufacturing errors
_BEYOND = 5.0  # tolerances: a normal distribution exceeds them once in two million times
_LEAST_SQUARES = LeastSquares()
_PARTS = 6  # of a session, each with a frame of its own, where something moved in between
_RMS_OF_MEDIAN = 1.126  # RMS over median of the norm of three standard normal numbers


@dataclass(frozen=True)
class Residuals:
    """Root mean square and largest 3-D distance between measured and predicted poses [m].

    Over the poses that the fit does not reject, with equal weights. The held-out figures are the
    *error left* of all outputs: the places are divided at random into five parts, each predicted
    by a fit to the other four, so that most of them lie between places that the fit has seen.
    """

    in_sample: float
    held_out: float  # the error left
    held_out_max: float
    held_out_whitened: float  # RMS in units of each coordinate's noise; 1 is the best possible


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
    return (1 + _FOLDS) * method.most(layout.size)


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
    layout = drawn.layout
    before = registered(drawn)
    require_this_robot(drawn, poses, robot)
    problem, near = drawn if carried is None else carried.applied(drawn), None
    if population is not None:
        plain = solve(problem)
        problem = carried_by(plain, population).applied(drawn)
        near = Near(
            problem.unknowns(plain.theta)
        )  # start: its residuals show the noise, not the prior
    prior = told_by(carried, population)
    rng = np.random.default_rng([seed, 1])
    fit = method.fit(problem, rng, watch, near)
    if not prior and isinstance(method, LeastSquares):
        fit = _freed(fit)
    full = fit.solution
    folds, counted = parts_of(poses, seed), full.weight > 0
    known = _known(full)
    used = float(np.trace(np.linalg.solve(known.whole, known.information)))
    chi_square, spread = _chi_squares(full, poses.place, used)
    basis = full.problem.basis[layout.chain]
    covariance = basis @ known.covariance(spread) @ basis.T
    variance = np.diag(covariance)
    if not ((variance >= 0.0) & (variance < np.inf)).all():
        raise SingularityError(
            f"{poses.source}: the uncertainty of robot {robot.name!r} is unbounded: is the "
            "nominal robot singular at the measured poses?"
        )
    drawing = full.theta.copy()
    drawing[layout.chain] = chain.join(*_nominal_but_frame(chain, full.theta))
    scale = np.diag(drawn.basis)
    about = replace(drawn, basis=np.eye(layout.size)).linearized(drawing)
    observability = observe(about.slope, scale, problem.names)
    visited = poses.joint
    if carried is not None:
        visited = np.concatenate([visited, carried.joint])
    nominal = chain.mechanism.forward(visited, chain.mechanism.parameters.nominal)
    missed_before = _held_out(before, folds, _LEAST_SQUARES, rng, watch)
    missed = _held_out(full, folds, method, rng, watch)
    theta = full.theta[layout.chain]
    return Identification(
        chain=chain,
        theta=theta,
        covariance=covariance,
        noise=noise,
        observability=observability,
        correlations=strong_correlations(covariance, chain.parameters.names),
        frame_only=_residuals(before, missed_before, counted),
        full=_residuals(full, missed, counted),
        frame_only_theta=before.theta[layout.chain],
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
            _missed(full, known, poses.place),
        ),
        turn_missed=_turn_missed(full),
        unseen_motion=poses.unseen_motion,
    )


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
    return _FEWEST if population is None else _FEWEST_OF_MANY


def _turn_missed(full: Solution) -> float | None:
    if not full.problem.layout.has_mount:
        return None
    return float(np.sqrt(np.mean(np.sum(_missed_by(full)[:, 3:] ** 2, axis=1))))


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


def distances(solution: Solution) -> Array:
    """3-D distance between measured and predicted, (n,) [m]."""
    return np.asarray(np.linalg.norm(_missed_by(solution)[:, :3], axis=1))


def _missed_by(solution: Solution) -> Array:
    """Measured less predicted, (n, d) [m, rad]."""
    missed = np.linalg.solve(solution.problem.whiten, solution.residual[..., None])
    return np.asarray(missed[..., 0])


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


def _nominal_but_frame(chain: Chain, theta: Array) -> tuple[Array, Array, Frame]:
    return chain.mechanism.parameters.nominal, chain.offset, chain.split(theta)[2]


def parts_of(poses: Poses, seed: int) -> Index:
    """Random held-out part of each pose, (n,); all poses of a place are in the same part."""
    places = np.unique(poses.place)
    part = np.random.default_rng(seed).permutation(len(places)) % min(_FOLDS, len(places))
    return np.asarray(part[np.searchsorted(places, poses.place)])


def _held_out(
    solution: Solution,
    folds: Index,
    method: Method,
    rng: np.random.Generator,
    watch: Watch,
) -> Array:
    """Held-out residuals: measured less predicted by a fit to the other parts, (n, 3) [m]."""
    problem = solution.problem
    missed = np.zeros_like(problem.y)
    for part in np.unique(folds):
        held, seen = np.flatnonzero(folds == part), np.flatnonzero(folds != part)
        fitted = method.fit(problem.take(seen), rng, watch, solution.near(seen)).solution
        at = problem.at.take(held)
        machine = problem.chain.see(at, fitted.theta[problem.layout.chain], asked="nothing")
        problem.chain.mechanism.require_reach(machine.x, at.joint, "held-out command")
        missed[held] = problem.y[held] - machine.reading
    return missed


def only(values: Array, counted: NDArray[np.bool_]) -> Array:
    """Rows (n, k) of the accepted poses, NaN for the others."""
    return np.where(counted[:, None], values, np.nan)


def _residuals(solution: Solution, missed: Array, counted: NDArray[np.bool_]) -> Residuals:
    whiten = solution.problem.whiten[counted, :3, :3]  # triangular: the position's own
    return residuals_of(distances(solution)[counted], missed[counted], whiten)


def residuals_of(in_sample: Array, missed: Array, whiten: Array) -> Residuals:
    """Compute the residual figures of the accepted poses.

    Args:
        in_sample: 3-D distance to the prediction by the fit to all poses, (n,) [m].
        missed: held-out residuals, measured less predicted, (n, 3) [m].
        whiten: whitening matrices, (n, 3, 3) [1/m].
    """
    distance = np.linalg.norm(missed, axis=1)
    whitened = (whiten @ missed[..., None])[..., 0]
    return Residuals(
        in_sample=float(np.sqrt(np.mean(in_sample**2))),
        held_out=float(np.sqrt(np.mean(distance**2))),
        held_out_max=float(distance.max()),
        held_out_whitened=float(np.sqrt(np.mean(whitened**2))),
    )


def _known(solution: Solution) -> Known:
    """Information of data and priors about the free unknowns, each pose with its weight."""
    slope, residual = _weighed(solution)
    flat = slope.reshape(-1, slope.shape[-1])
    return Known(flat.T @ flat, flat.T @ residual.reshape(-1), solution.problem.expected)


def _weighed(solution: Solution) -> tuple[Array, Array]:
    """Whitened Jacobian (n, d, F) and residuals at z = 0 (n, d), times the root of the weight."""
    root = np.sqrt(solution.weight)[:, None]
    slope = root[..., None] * solution.at.slope
    return slope, root * solution.residual + slope @ solution.z


def _chi_squares(solution: Solution, place: Index, used: float) -> tuple[float, float]:
    """Chi square per degree of freedom: of all poses, and of the means of the places.

    A model error is the same at every visit of a place; backlash to either side cancels.
    """
    weight, width = solution.weight, solution.residual.shape[1]
    residual = weight[:, None] * solution.residual
    visits = np.bincount(place, weight > 0)
    mean = np.array([np.bincount(place, each) for each in residual.T]).T[visits > 0]
    mean /= np.sqrt(visits[visits > 0])[:, None]
    degrees = width * np.array([np.count_nonzero(weight), len(mean)]) - used
    squares = np.array([np.sum(residual**2), np.sum(mean**2)])
    found = squares / np.maximum(degrees, 1.0)
    return float(found[0]), float(found[1])


def _missed(solution: Solution, known: Known, place: Index) -> Missed:
    """Studentized residuals of all poses: as large as if the fit had absorbed none of them."""
    problem, counted = solution.problem, solution.weight > 0
    slope, residual = _weighed(solution)
    root = np.sqrt(np.where(counted, solution.weight, 1.0))
    colour = np.linalg.inv(problem.whiten[:, :3, :3]) / root[:, None, None]
    missed = colour @ studentized(known, slope, residual, place)[:, :3, None]
    return Missed(problem.at, only(missed[..., 0], counted), problem.whiten[:, :3, :3], place)


def require_this_robot(problem: Problem, poses: Poses, robot: Robot) -> None:
    """Refuse residuals that are many times larger than the tolerances explain.

    The medians of both are compared, with gross errors left out if they decide: one reading of
    another reflector does not make another robot, and tolerances have an untypical effect near a
    singularity. Reflector offset and tracker frame are not parts of the robot and do not count
    among what its tolerances explain. A tracker that was pushed, or a joint that slipped, makes no
    other robot: most parts of the session in the order of time fit it, each in a frame of its own.
    If tolerances do not explain the residuals, effects of usual size in drives and parts count.

    Args:
        problem: with all parameters free and the drawing's priors.
        poses: the measured poses.
        robot: drawing and tolerances.

    Raises:
        DataError: another robot, or other units.
    """
    layout = problem.layout
    geometry = layout.geometry
    placed = problem.only(~layout.mask(geometry, layout.effects))
    # at the nominal machine: a badly fitted reflector offset would magnify the tolerances' effect
    slope = problem.chain.jacobian(problem.at, problem.theta0[layout.chain])[..., geometry]
    spread = slope * problem.chain.mechanism.parameters.prior
    expected = float(np.median(np.linalg.norm(spread, axis=(1, 2))))
    most = _ANOTHER_ROBOT * expected
    typical = _typical(placed, False)
    if typical > most:
        typical = _typical(placed, True)
    if typical > most:
        expected = _expected_with_effects(problem, robot, spread)
        most = _ANOTHER_ROBOT * expected
    if typical > most and not _fits_in_parts(placed, poses, most):
        raise DataError(
            f"{poses.source}: {typical * 1e3:.1f} mm (robust RMS) remain between robot "
            f"{robot.name!r} in its best-fit frame and the tracker, while its tolerances and "
            f"usual effects explain {expected * 1e3:.1f} mm: is it the session of another robot, "
            "or are joint zeros or units different? `delta-cal check` finds such mistakes"
        )


def _expected_with_effects(problem: Problem, robot: Robot, spread: Array) -> float:
    """Median displacement by the tolerances and by effects of usual size in drives and parts [m].

    Pulleys can move a cable robot farther than the tolerances of its anchors do.

    Args:
        problem: of the poses.
        robot: drawing and tolerances.
        spread: displacement by each tolerance, (n, 3, p) [m].
    """
    chain, at = problem.chain, problem.at
    square = np.sum(spread**2, axis=(1, 2))
    for effect in catalogue(robot, chain.mechanism):
        of_robot = effect.stage in (Stage.DRIVE, Stage.STRUCTURE)
        if not of_robot or effect.free_form or effect.lacking or effect.missing(at):
            continue
        own = chain.with_effects((effect,))
        theta = np.append(problem.theta0[problem.layout.chain], effect.about)
        slope = own.jacobian(at, theta)[..., own.layout.effects] * effect.parameters.prior
        square = square + np.nan_to_num(np.sum(slope**2, axis=(1, 2)))
    return float(np.median(np.sqrt(square)))


def _typical(problem: Problem, robust: bool) -> float:
    """Robust root mean square of the distances that a fit leaves [m]."""
    return _RMS_OF_MEDIAN * float(np.median(distances(solve(problem, robust=robust))))


def _fits_in_parts(placed: Problem, poses: Poses, most: float) -> bool:
    """Whether all parts of a session but one leave at most so much, each in its own frame [m].

    Each of at least three parts needs as many different places as a fit; a frame follows fewer.
    """
    count = min(_PARTS, len(poses) // _FEWEST)
    parts = np.array_split(np.argsort(poses.time, kind="stable"), max(count, 1))
    if count < 3 or min(len(np.unique(poses.place[rows])) for rows in parts) < _FEWEST:
        return False
    left = sorted(_typical(placed.take(np.sort(rows)), True) for rows in parts)
    return left[-2] <= most
