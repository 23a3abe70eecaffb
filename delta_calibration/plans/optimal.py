"""D-optimal pose selection: the stops with the most information about the wanted parameters.

With A_i the whitened rows of stop i in the Jacobian, M = M_0 + sum_i A_i' A_i the information
matrix and M_0 that of the priors (and of earlier measurements), the stops maximise

    log det M                   for all parameters, for a fit
    log det M - log det M_n     for some beside nuisance parameters n (D_s-optimal), for a contrast

They are chosen one after the other, then exchanged (Fedorov) until no exchange improves. By
Sylvester's identity a stop adds log det(1 + A_i M^-1 A_i'), a 3 x 3 determinant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.data import at_rest
from delta_calibration.diagnosis.predicted_information import Foresight, Samples
from delta_calibration.diagnosis.shared_path_error import AT_REST
from delta_calibration.errors import InputError
from delta_calibration.estimation import (
    Measured,
    Noise,
    Observability,
    PointMeasured,
    Problem,
    build_problem,
    chain_of,
    whitening,
)
from delta_calibration.estimation.observability import observe
from delta_calibration.geometry import Frame
from delta_calibration.geometry.halton import halton
from delta_calibration.mechanisms import Mechanism
from delta_calibration.plans.motion import APPROACH, Plan
from delta_calibration.plans.points import joints_toward, tool_frames, tool_points, usable
from delta_calibration.plans.workspace import drawn
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_TRACKER = 3.0  # [m] assumed distance of the tracker from the base
_READINGS = 20  # averaged at a stop
_ON_PATH = 4  # averaged on a path
WEAK = 1e-6  # precision of unknowns without prior: the frame, to a metre
SIDES = (1.0, -1.0)  # from which each stop is approached
_CANDIDATES = 2000
_ON_THE_WAY = 10  # steps from home to a pose
_SAME = 1e-6  # [m, rad] by which equal poses may differ
_DRAWS = 20  # draws at most, each of as many candidates as are needed
_PASSES = 8  # rounds of exchanges at most
_GAIN = 1e-6  # least gain of an exchange
_RANDOM = 20  # random plans to compare with


def choose(
    rows: Array,
    start: Array,
    count: int,
    asked: int,
    follow: Callable[[range], Iterable[int]] = iter,
) -> Index:
    """Rows of the most informative stops, each at most once, (count,).

    Args:
        rows: whitened rows of the Jacobian for each of N candidates, (N, d, P).
        start: information matrix before these stops, (P, P), positive definite.
        count: number of stops.
        asked: number of wanted parameters, the last of the P columns; P for all.
        follow: iterates over the steps; for a progress bar.
    """
    chosen: list[int] = []
    information = start.copy()
    swapped = 0
    for step in follow(range(count * (1 + _PASSES))):
        out: int | None = None
        if step >= count:
            if step % count == 0:
                if step > count and not swapped:
                    break
                swapped = 0
            out = chosen.pop(0)
            information -= rows[out].T @ rows[out]
        gains = _gains(rows, information, asked)
        gains[chosen] = -np.inf
        best = int(np.argmax(gains))
        if out is not None and gains[best] <= gains[out] + _GAIN:
            best = out
        swapped += best != out
        chosen.append(best)
        information += rows[best].T @ rows[best]
    return np.array(chosen, dtype=np.int64)


def _gains(rows: Array, information: Array, asked: int) -> Array:
    """Gain in the criterion by each candidate, (N,)."""
    size = len(information)
    gains = _log_det(rows, information)
    if asked < size:
        rest = size - asked
        gains -= _log_det(rows[..., :rest], information[:rest, :rest])
    return gains


def _log_det(rows: Array, information: Array) -> Array:
    seen = rows @ np.linalg.inv(information) @ np.swapaxes(rows, 1, 2)
    return np.asarray(np.linalg.slogdet(np.eye(rows.shape[1]) + seen)[1])


def foresight_of(robot: Robot, known: tuple[Chain, Array] | None = None) -> Foresight:
    """Prediction of the information from stops of a robot, with the noise of its file.

    Args:
        robot: nominal dimensions, tolerances, noise.
        known: chain and theta of a calibration; by default the nominal robot with the tracker
            three metres away.
    """
    if known is None:
        chain = chain_of(robot)
        theta = drawn_theta(chain)
    else:
        chain, theta = known
    problem = unmeasured(chain, theta)
    base = chain.layout.base
    return Foresight(
        chain,
        theta,
        problem.basis[base, base],
        np.where(problem.has_prior, 1.0, WEAK)[base],
        FiledNoise(robot, chain, theta),
    )


def drawn_theta(chain: Chain) -> Array:
    """Theta of the nominal robot with the tracker three metres away, (P,)."""
    place = Frame(np.eye(3), np.array([_TRACKER, 0.0, 0.0]))
    return chain.join(chain.mechanism.parameters.nominal, chain.offset, place)


def unmeasured(chain: Chain, theta: Array) -> Problem:
    """The fit problem of a chain about theta, (P,), without any measurement."""
    nowhere, none = np.zeros((0, chain.mechanism.joints)), np.zeros((0, 3))
    measured = Measured(PointMeasured(nowhere, none, None, 1.0), at_rest(nowhere))
    return build_problem(chain, measured, theta)


@dataclass(frozen=True)
class FiledNoise:
    """Whitening of stops and of readings in motion with the noise of the robot's file."""

    robot: Robot
    chain: Chain
    theta: Array

    def __call__(self, samples: Samples, x: Array) -> Array:
        """Whitening matrices of samples at poses x (n, k), (n, 3, 3) [1/m]."""
        at, joints = samples.at, self.robot.joints
        noise = Noise(1.0, 1.0, joints.repeatability, 0.0, 0, False)
        seen = self.chain.see(at, self.theta, x)
        slope, reading = seen.by_joints, noise.reading(seen.reading, self.robot.tracker)
        resting = (samples.path == AT_REST)[:, None, None]
        spread = np.where(resting, joints.repeatability, joints.encoder / np.sqrt(_ON_PATH))
        readings = np.where(resting, _READINGS, _ON_PATH)
        covariance = reading / readings + spread**2 * slope @ np.swapaxes(slope, 1, 2)
        return whitening(covariance)


def candidates(
    robot: Robot,
    count: int,
    radius: float | None,
    rng: np.random.Generator,
    payloads: Sequence[float] = (0.0,),
    follow: Callable[[range], Iterable[int]] = iter,
) -> Array:
    """Candidate joints spread over all poses that the robot can take, (count, m) [rad or m].

    The poses are those of the file's workspace with the rotations allowed there; without a
    workspace, those of joint vectors all over their ranges, in the assembly mode of home. All are
    within the joint limits, with room for the approach to a stop, and well conditioned, which also
    bounds the rotation of ball joints. Cables are taut with each of the payloads.

    Args:
        robot: limits and nominal dimensions.
        count: number of poses.
        radius: largest distance of the tool from the axis [m]; None for no limit.
        rng: source of the random draws.
        payloads: payloads of the plan [kg].
        follow: iterates over the steps; for a progress bar.

    Raises:
        InputError: too small a radius, too heavy a payload, or no workspace for a mechanism none
            of whose joints moves alone.
    """
    model = robot.commanded
    if robot.workspace is None and model.joints > model.task_size:
        raise InputError(
            f"{robot.source}: poses are selected in its `workspace`, but it has none; a "
            f"{model.name} needs one, because none of its joints moves alone"
        )
    spread = _in_joints if robot.workspace is None else _in_workspace
    found: list[Array] = []
    for _, (points, turns) in zip(follow(range(_DRAWS)), spread(robot, count, rng), strict=False):
        good = usable(robot, points, turns, payloads)
        if radius is not None:
            good &= np.hypot(points[:, 0], points[:, 1]) <= radius
        found.append(joints_toward(robot, points[good], turns[good]))
        if sum(map(len, found)) >= count:
            return np.concatenate(found)[:count]
    heavy = f" with {max(payloads):g} kg" if any(payloads) else ""
    raise InputError(
        f"only {sum(map(len, found))} of {count} candidate poses lie within the limits"
        f"{heavy}; choose a larger radius, less payload or fewer stops"
    )


def _in_workspace(
    robot: Robot, count: int, rng: np.random.Generator
) -> Iterator[tuple[Array, Array]]:
    """Yield tool points and rotations all over the workspace, (count, 3) each [m, rad]."""
    if robot.workspace is not None:
        yield from drawn(robot.workspace, count, rng)


def _in_joints(
    robot: Robot, count: int, rng: np.random.Generator
) -> Iterator[tuple[Array, Array]]:
    """Yield tool points and rotations of joints all over their ranges, in the mode of home."""
    room = 2 * APPROACH * robot.commanded.joint_size
    lower, upper = robot.joints.lower + room, robot.joints.upper - room
    shift = rng.random(len(lower))
    for i in range(_DRAWS):
        share = np.mod(halton(count, len(lower), i * count) + shift, 1.0)
        joint = lower + (upper - lower) * share
        yield tool_frames(robot, joint[_in_mode(robot.commanded, joint)])


def _in_mode(model: Mechanism, joint: Array) -> NDArray[np.bool_]:
    """Whether joints (n, m) are in the assembly mode of home, (n,).

    The pose is followed from home, straight in joint space, and compared with that of the forward
    kinematics, which from its own start may end in another assembly mode, or a turn further.
    """
    nominal, home = model.parameters.nominal, model.home
    x = np.tile(model.forward(home[None], nominal), (len(joint), 1))
    for share in np.linspace(0.0, 1.0, _ON_THE_WAY + 1)[1:]:
        x = model.forward(home + share * (joint - home), nominal, x)
    gap = np.abs(x - model.forward(joint, nominal)).max(axis=1)
    return np.asarray(gap < _SAME)  # NaN compares false


@dataclass(frozen=True)
class OptimalPlan:
    """Optimal stops for a fit of the geometry, with their quality."""

    plan: Plan
    candidates: int  # number of poses that the stops were chosen from
    log_det: float
    random_log_det: float  # mean over random plans with as many stops
    observability: Observability

    @property
    def worth(self) -> float:
        """Factor by which the number of random stops must be larger for the same information."""
        return float(np.exp((self.log_det - self.random_log_det) / self.observability.rank))


def optimal_plan(
    robot: Robot,
    count: int = 40,
    *,
    dwell: float = 1.0,
    radius: float | None = None,
    seed: int = 0,
    follow: Callable[[range], Iterable[int]] = iter,
) -> OptimalPlan:
    """Select the D-optimal stops to fit geometry, reflector offset and frame, from both sides.

    Args:
        robot: nominal dimensions, tolerances, limits.
        count: number of different stops.
        dwell: at each stop [s].
        radius: largest distance of the tool from the axis [m]; None for no limit.
        seed: seed of the candidates and of the order.
        follow: iterates over the steps; for a progress bar.

    Raises:
        InputError: fewer stops than a fit needs, or too small a radius.
    """
    rng = np.random.default_rng(seed)
    foresight = foresight_of(robot)
    joint = candidates(robot, max(_CANDIDATES, 2 * count), radius, rng, follow=follow)
    samples = Samples(at_rest(joint), np.full(len(joint), AT_REST))
    rows = foresight.evidence(samples, foresight.pose(samples)).nuisance
    start = np.diag(foresight.precision)
    chosen = rng.permutation(choose(rows, start, count, len(start), follow))
    by_chance = [
        _information(rows, start, rng.choice(len(rows), count, replace=False))
        for _ in range(_RANDOM)
    ]
    names = foresight.chain.parameters.names
    stops = joint[chosen]
    return OptimalPlan(
        Plan.around("identify", tool_points(robot, stops), stops, SIDES, dwell),
        len(rows),
        _information(rows, start, chosen),
        float(np.mean(by_chance)),
        observe(rows[chosen] @ np.linalg.inv(foresight.scale), np.diag(foresight.scale), names),
    )


def _information(rows: Array, start: Array, chosen: Index) -> float:
    """log det M of the chosen stops."""
    flat = rows[chosen].reshape(-1, rows.shape[-1])
    return float(np.linalg.slogdet(start + flat.T @ flat)[1])
