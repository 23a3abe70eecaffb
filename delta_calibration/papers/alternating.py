"""Geometry and device frame from residuals in joint coordinates: in turn, or both at once.

Paper 002's procedure: the geometry is fitted in the frame as it is known (its (4), (5)), then the
frame with that geometry, and so on until both stand still. In turn, each fit takes up what it can
of the other's error, so the two approach their common answer by a constant factor a round; what
geometry and frame can do alike (a gauge) stays where it happened to be. Both at once takes a few
steps. Plain weighted least squares with priors as rows where the problem wants them; nothing is
done against gross errors.

`in_turn` is the same on the error model of a session, where a device reads positions and no joint
of a measured pose can be computed: a round costs two products there, and a hundred thousand of
them are nothing.
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

STILL = 1e-6  # of its expected size: an unknown that moves less stands still
_STEPS = 50  # of one fit
_HALVINGS = 12
_ROUNDING = 1e-12  # a cost that grows by such a share has not grown
_SHOWN = 1e-9  # singular directions under this share of the largest are not moved along


@dataclass(frozen=True)
class TogetherFit:
    """Geometry and frame at rest, and what it cost."""

    geometry: Array  # (p,)
    frame: Frame  # T_device_robot
    residual: Array  # (n, m) [rad]
    cost: float  # whitened squares, and those of the priors
    rounds: int  # 1 where both were fitted at once
    evaluations: int  # of the inverse problem of all poses
    slopes: int  # of its derivatives
    observability: Observability

    @property
    def rms(self) -> float:
        """Root mean square of the residuals [rad]."""
        return float(np.sqrt(np.mean(self.residual**2)))


def alternate(
    problem: JointProblem, frame: Frame | None = None, rounds: int = 200, still: float = STILL
) -> TogetherFit:
    """Geometry with the frame held, frame with the geometry held, until both stand still.

    Args:
        problem: joints, poses, weights.
        frame: where the robot is believed to stand in the device; else the nominal machine's best.
        rounds: after which the two are taken not to come to rest.
        still: largest change in a round, in expected sizes, that counts as none.

    Raises:
        DataError: too few poses, poses out of reach, or no rest within `rounds`.
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
    """Geometry and frame at once; the same answer where nothing is left to a gauge.

    Raises:
        DataError: too few poses, or poses out of reach.
    """
    now = _start(problem, frame)
    everything = np.ones(len(problem.names), dtype=bool)
    return _result(problem, _descend(problem, now, everything, still), 1)


def in_turn(
    line: LinearResidual, first: Mask, start: Array, rounds: int, still: float = 1e-5
) -> SwarmResult:
    """Some of an error model's unknowns with the others held, then those, until all stand still.

    Args:
        line: by unknowns in units of their expected sizes, (F,).
        first: which of them are fitted first in a round.
        start: of all, (F,).
        rounds: after which they are taken not to come to rest.
        still: largest change in a round that counts as none.

    Raises:
        DataError: no rest within `rounds`.
    """
    one, other = (np.linalg.pinv(line.factor[:, part]) for part in (first, ~first))
    by_other, by_one = -one @ line.factor[:, ~first], -other @ line.factor[:, first]
    alone = one @ line.target, other @ line.target
    # a round is the same linear map each time: there and back in one
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
        f"after {rounds} rounds; under {still:g} was wanted: allow more, or fit both at once"
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
    """(actual - nominal) / prior, (p,); 0 where there is none."""
    parameters = problem.mechanism.parameters
    return (geometry - parameters.nominal) / parameters.prior * problem.priors


def _descend(problem: JointProblem, now: _State, moving: Mask, still: float) -> _State:
    """Gauss-Newton in some of the unknowns, each step halved until it lowers the cost."""
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
    """Least-norm Gauss-Newton step in expected sizes, (p + 6,); 0 where nothing moves."""
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
