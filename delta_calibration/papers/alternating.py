"""Fits geometry and device frame to residuals in joint coordinates: alternating, or together.

Paper 002's procedure: the geometry is fitted with the frame held (its (4), (5)), then the frame
with the geometry held, and so on until both converge. Each fit absorbs part of the other's error,
so the alternation converges linearly, by a constant factor per round; a change that geometry and
frame can make alike (a gauge) is not determined and depends on the start. The fit of both together
takes a few steps. Plain weighted least squares, with priors as rows if the problem requires them;
not robust against gross errors.

`in_turn` alternates on the error model of a session, in which a device reads positions and the
joints of a measured pose cannot be computed: a round costs two matrix products there, so a hundred
thousand rounds are cheap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.estimation.observability import Observability, observe
from delta_calibration.geometry import Frame
from delta_calibration.papers.joint_residual import JointProblem
from delta_calibration.papers.pose_residual import LinearResidual
from delta_calibration.papers.swarm import SwarmResult

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STILL = 1e-6  # an unknown that moves by less, in expected sizes, has converged
_STEPS = 50  # of one fit
_HALVINGS = 12
_ROUNDING = 1e-12  # relative growth of the cost that counts as rounding
_SHOWN = 1e-9  # directions with smaller singular values, relative to the largest, are not moved


@dataclass(frozen=True)
class TogetherFit:
    """Converged geometry and frame, with the effort of the fit."""

    geometry: Array  # (p,)
    frame: Frame  # T_device_robot
    residual: Array  # (n, m) [rad]
    cost: float  # sum of squares of the whitened residuals and of the priors
    rounds: int  # 1 if both were fitted together
    evaluations: int  # of the inverse kinematics of all poses
    slopes: int  # evaluations of its derivatives
    observability: Observability

    @property
    def rms(self) -> float:
        """Root mean square of the residuals [rad]."""
        return float(np.sqrt(np.mean(self.residual**2)))


def alternate(
    problem: JointProblem, frame: Frame | None = None, rounds: int = 200, still: float = STILL
) -> TogetherFit:
    """Fit the geometry with the frame held, then the frame, in turn until both converge.

    Args:
        problem: joints, poses, weights.
        frame: start value of `T_device_robot`; by default the best fit of the nominal machine.
        rounds: largest number of rounds.
        still: largest change in a round, in expected sizes, that counts as converged.

    Raises:
        DataError: too few poses, poses out of reach, or no convergence within `rounds`.
    """
    now = _start(problem, frame)
    geometry = problem.layout.mask(problem.layout.geometry)
    moved = np.inf
    for count in range(1, rounds + 1):
        last = now
        now = _descend(problem, _descend(problem, now, geometry, still), ~geometry, still)
        moved = _apart(problem, last, now)
        if moved < still:
            return _result(problem, now, count)
    raise _restless(moved, still, rounds)


def fit_together(
    problem: JointProblem, frame: Frame | None = None, still: float = STILL
) -> TogetherFit:
    """Fit geometry and frame together; the result equals `alternate`'s unless there is a gauge.

    Raises:
        DataError: too few poses, or poses out of reach.
    """
    now = _start(problem, frame)
    everything = np.ones(len(problem.names), dtype=bool)
    return _result(problem, _descend(problem, now, everything, still), 1)


def in_turn(
    line: LinearResidual, first: Mask, start: Array, rounds: int, still: float = 1e-5
) -> SwarmResult:
    """Fit two groups of an error model's unknowns alternately until all converge.

    Args:
        line: error model in unknowns in units of their expected sizes, (F,).
        first: mask of the group that is fitted first in a round, (F,).
        start: start values of all unknowns, (F,).
        rounds: largest number of rounds.
        still: largest change in a round that counts as converged.

    Raises:
        DataError: no convergence within `rounds`.
    """
    one, other = (np.linalg.pinv(line.factor[:, part]) for part in (first, ~first))
    by_other, by_one = -one @ line.factor[:, ~first], -other @ line.factor[:, first]
    alone = one @ line.target, other @ line.target
    # every round is the same linear map, so both fits are combined into one product
    whole, back = by_other @ by_one, alone[0] + by_other @ alone[1]
    now = alone[0] + by_other @ start[~first]
    for count in range(1, rounds + 1):
        last, now = now, back + whole @ now
        moved = max(np.abs(now - last).max(), np.abs(by_one @ (now - last)).max())
        if moved < still:
            best = np.array(start)
            best[first], best[~first] = now, alone[1] + by_one @ now
            norm = float(line(best[None])[0])
            return SwarmResult(best, norm, 2 * count, np.array([norm]))
    raise _restless(moved, still, rounds)


def _restless(moved: float, still: float, rounds: int) -> DataError:
    return DataError(
        f"geometry and frame, fitted in turn, still move by {moved:.2g} of their expected size "
        f"after {rounds} rounds; under {still:g} was wanted: allow more rounds, or fit both at "
        "once"
    )


@dataclass(frozen=True)
class _State:
    geometry: Array
    frame: Frame
    residual: Array  # (n, m) [rad]
    cost: float
    evaluations: int
    slopes: int


def _start(problem: JointProblem, frame: Frame | None) -> _State:
    problem.require_enough()
    nominal = problem.mechanism.parameters.nominal
    now = _state(problem, nominal, problem.start_frame() if frame is None else frame, 0, 0)
    problem.mechanism.require_reach(now.residual, problem.pose, "measured pose", "m, rad")
    return now


def _state(
    problem: JointProblem, geometry: Array, frame: Frame, evaluations: int, slopes: int
) -> _State:
    residual = problem.residual(geometry, frame)
    white = (problem.whiten @ residual[..., None])[..., 0]
    cost = float(np.sum(white**2) + np.sum(_prior_misses(problem, geometry) ** 2))
    cost = cost if np.isfinite(cost) else np.inf
    return _State(geometry, frame, residual, cost, evaluations + 1, slopes)


def _prior_misses(problem: JointProblem, geometry: Array) -> Array:
    """Residuals of the priors, (actual - nominal) / prior, (p,); 0 for a parameter without."""
    parameters = problem.mechanism.parameters
    return (geometry - parameters.nominal) / parameters.prior * problem.priors


def _descend(problem: JointProblem, now: _State, moving: Mask, still: float) -> _State:
    """Gauss-Newton iteration in the unknowns `moving`; steps are halved until the cost falls."""
    for _ in range(_STEPS):
        step = _step(problem, now, moving)
        now = replace(now, slopes=now.slopes + 1)
        for _ in range(_HALVINGS):
            tried = _moved(problem, now, step)
            if tried.cost <= (1 + _ROUNDING) * now.cost:
                break
            now, step = replace(now, evaluations=tried.evaluations), step / 2
        else:
            return now
        now = tried
        if np.max(np.abs(step)) < still:
            return now
    return now


def _step(problem: JointProblem, now: _State, moving: Mask) -> Array:
    """Least-norm Gauss-Newton step in expected sizes, (p + 6,); 0 for unknowns that are held."""
    size = len(problem.names)
    slope = problem.whiten @ (problem.slopes(now.geometry, now.frame) * problem.scale)
    white = (problem.whiten @ now.residual[..., None])[..., 0]
    prior = np.isfinite(problem.mechanism.parameters.prior) & problem.priors
    rows = np.concatenate([slope.reshape(-1, size), np.eye(size)[problem.layout.geometry][prior]])
    right = np.append(white.reshape(-1), -_prior_misses(problem, now.geometry)[prior])
    step = np.zeros(size)
    step[moving] = np.linalg.lstsq(rows[:, moving], right, rcond=_SHOWN)[0]
    return step


def _moved(problem: JointProblem, now: _State, step: Array) -> _State:
    change = problem.layout.split(step * problem.scale)
    geometry = now.geometry + change.geometry
    frame = now.frame @ Frame.from_vector(change.frame)
    return _state(problem, geometry, frame, now.evaluations, now.slopes)


def _apart(problem: JointProblem, one: _State, other: _State) -> float:
    """Largest difference of two states in expected sizes."""
    frame = (one.frame.inverse() @ other.frame).vector()
    change = np.append(other.geometry - one.geometry, frame)
    return float(np.max(np.abs(change) / problem.scale))


def _result(problem: JointProblem, now: _State, rounds: int) -> TogetherFit:
    jacobian = problem.whiten @ problem.slopes(now.geometry, now.frame)
    seen = observe(jacobian, problem.scale, problem.names)
    return TogetherFit(
        now.geometry, now.frame, now.residual, now.cost, rounds, now.evaluations, now.slopes, seen
    )
