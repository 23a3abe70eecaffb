"""Compensation of trajectories point by point, for a controller that interpolates the points.

    q_i' = q_i + dq_i,    v_i' = v_i + (d dq*/dq) v_i

dq_i is the correction on the ramp of the command path at the time of the point. The velocity is
corrected by the change of dq* along the motion, so that the controller's interpolation matches the
corrected points; while a correction fades in or out, the velocity is not changed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell.command_path import (
    ALREADY,
    BEYOND,
    BLENDED,
    HOLD,
    LIMIT,
    LIMITED,
    PASSED,
    CommandPath,
)
from delta_calibration.cell.surroundings import Surroundings
from delta_calibration.compensation import CommandStatus, Compensated
from delta_calibration.data import Conditions, joined
from delta_calibration.errors import CalibrationError, DataError

Array = NDArray[np.float64]

REFUSED = "trajectory refused"
_ASIDE = 1e-5  # [rad] central-difference step for the change of the correction along the motion


@dataclass(frozen=True)
class Points:
    """A trajectory of n points."""

    time: Array  # (n,) [s] steady, rising
    joint: Array  # (n, m) [rad]
    velocity: Array | None = None  # (n, m) [rad/s]
    compensated: bool = False
    carried: Array | None = None  # (n, k) positions of the pass-through axes
    turning: Array | None = None  # (n, k) their velocities, if the joints have velocities

    @property
    def whole(self) -> tuple[Array, Array | None]:
        """Positions and velocities of the joints, then of the pass-through axes, (n, m + k)."""
        joint, velocity = self.joint, self.velocity
        if self.carried is not None:
            joint = np.hstack([joint, self.carried])
        if velocity is not None and self.turning is not None:
            velocity = np.hstack([velocity, self.turning])
        return joint, velocity


@dataclass(frozen=True)
class Sent:
    """Result of the compensation of a trajectory, with the state of the corrections after it."""

    points: Points | CalibrationError  # points to send, or the reason for refusing them
    by: TrajectoryPath
    now_s: float  # steady time at the start of the computation [s]


class TrajectoryPath:
    """Corrects trajectories with the compensator, ramp, policy and counts of a command path.

    With `pass_through` a point that fails a guard is sent uncorrected, and the corrections around
    it change at the allowed rate; with `hold` the whole trajectory is refused, and the controller
    keeps the one it has. Switching compensation acts on the next trajectory.
    """

    def __init__(self, path: CommandPath) -> None:
        self._path = path
        self.reset()

    def reset(self) -> None:
        """Forget the trajectory that was sent."""
        self._plan: tuple[Array, Array] | None = None  # times [s], corrections [rad]

    @property
    def under_way(self) -> bool:
        """Whether a controller is executing a trajectory that was sent."""
        return self._plan is not None

    def settle(self, now_s: float) -> None:
        """Set the path's correction to the present one of the trajectory under way."""
        if self._plan is None:
            return
        time, dq = self._plan
        columns = [np.interp(now_s, time, column) for column in dq.T]
        self._path.ramp.stands(np.array(columns), now_s)
        if now_s >= time[-1]:
            self._plan = None

    def begin(
        self,
        points: Callable[[], tuple[Points, bool]],
        now_s: float,
        around: Surroundings | None = None,
    ) -> Callable[[], Sent]:
        """Return the work of `send` on the present state, as a function for any thread.

        Args:
            points: function that returns the commanded points and whether they are marked as
                compensated; it is called as part of the work.
            now_s: steady time [s].
            around: conditions, if the compensator needs them.
        """
        self.settle(now_s)
        shadow = TrajectoryPath(self._path.shadow())
        around = None if around is None else around.ahead()

        def work() -> Sent:
            try:
                made, already = points()
                sent: Points | CalibrationError = shadow.send(made, now_s, already, around)
            except CalibrationError as error:
                sent = error
            return Sent(sent, shadow, now_s)

        return work

    def end(self, sent: Sent, late_s: float = 0.0) -> Points:
        """Apply the result of `begin`, and return the points to send.

        Args:
            sent: result of the function that `begin` returned.
            late_s: delay of the points against the times they were computed for [s].

        Raises:
            CalibrationError: the points are refused.
        """
        path, shadow = self._path, sent.by._path
        path.counts += shadow.counts
        path.trouble = shadow.trouble
        if isinstance(sent.points, CalibrationError):
            raise sent.points
        path.ramp = shadow.ramp
        plan = sent.by._plan
        self._plan = None if plan is None else (plan[0] + late_s, plan[1])
        self.settle(sent.now_s + late_s)
        return sent.points

    def send(
        self,
        points: Points,
        now_s: float,
        already: bool = False,
        around: Surroundings | None = None,
    ) -> Points:
        """Compensate a trajectory and return the points for the controller.

        Args:
            points: points as commanded.
            now_s: steady time [s].
            already: whether the trajectory is marked as compensated.
            around: conditions, if the compensator needs them.

        Raises:
            DataError: a point fails a guard and the policy is `hold`; or a point is beyond a joint
                limit and the policy for that is `refuse`.
        """
        path = self._path
        path.trouble = None
        self.settle(now_s)
        inside = path.inside(points.joint)
        if inside is None:
            path.count(BEYOND)
            raise DataError(f"trajectory {BEYOND}")
        points = replace(points, joint=inside)
        if already:
            path.count(ALREADY)
            return replace(points, compensated=True)
        compensator, n = path.compensator, len(points.joint)
        if not path.enabled or compensator is None:
            path.counts[PASSED] += n
            return self._ramped(points, np.zeros_like(points.joint), [None] * n, now_s)
        at = None if around is None else _conditions(points, around)
        found = compensator.compensate(points.joint, at)
        good = self._judged(found)
        sources = [compensator if fine else None for fine in good]
        sent = self._ramped(points, found.correction, sources, now_s)
        if points.velocity is None:
            return sent
        settled = good & (np.abs(sent.joint - found.joint) <= _ASIDE * 1e-3).all(axis=1)
        h = _aside(points.velocity)
        bend = [
            compensator.compensate(points.joint + side * points.velocity, at).correction
            for side in (h, -h)
        ]
        change = np.where(settled[:, None], (bend[0] - bend[1]) / (2 * h), 0.0)
        return replace(sent, velocity=points.velocity + change)

    def _judged(self, found: Compensated) -> NDArray[np.bool_]:
        """Count the verdicts and return which points are corrected; with `hold`, refuse others."""
        path = self._path
        good = np.array([verdict is CommandStatus.CORRECTED for verdict in found.verdicts])
        for row, verdict in enumerate(found.verdicts):
            path.counts[verdict.value] += 1
            if found.blended(row):
                path.counts[BLENDED] += 1
        if good.all():
            return good
        worst = int(np.flatnonzero(~good)[0])
        path.trouble = f"point {worst}: {found.verdicts[worst].value}"
        if path.on_failure == HOLD:
            path.counts[REFUSED] += 1
            raise DataError(path.trouble)
        return good

    def _ramped(
        self, points: Points, goal: Array, sources: Sequence[object], now_s: float
    ) -> Points:
        ramp, before = copy(self._path.ramp), self._path.ramp.limited
        steps = zip(goal, sources, points.time, strict=True)
        dq = np.array([ramp.toward(g, source, float(t)) for g, source, t in steps])
        inside = self._path.within(points.joint, points.joint + dq)
        if inside is not None:
            self._path.counts[LIMIT] += 1
            dq = inside - points.joint
            ramp.applied = dq[-1]
        # Before the first point the controller moves from its present position.
        whole = np.vstack([np.broadcast_to(self._path.ramp.applied, dq[:1].shape), dq])
        self._path.ramp = ramp
        if ramp.limited > before:
            self._path.counts[LIMITED] += ramp.limited - before
        self._plan = np.concatenate([[min(now_s, float(points.time[0]))], points.time]), whole
        self.settle(now_s)
        marked = self._path.enabled or bool(dq.any())
        return replace(points, joint=points.joint + dq, compensated=marked)


def _aside(velocity: Array) -> float:
    """Time [s] in which the fastest joint moves by `_ASIDE`."""
    return float(_ASIDE / max(np.abs(velocity).max(), 1e-9))


def _conditions(points: Points, around: Surroundings) -> Conditions:
    """Conditions of every point, as if the points were a stream of commands."""
    ahead = around.ahead()
    each = []
    for row, (t, q) in enumerate(zip(points.time.tolist(), points.joint, strict=True)):
        ahead.moved(q, int(t * 1e9))
        at = ahead.at(q, t)
        if points.velocity is not None:
            at = replace(at, velocity=points.velocity[row : row + 1])
        each.append(at)
    return joined(*each)
