"""The motion of a plan: joint angles over time, with soft starts and stops."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

APPROACH = 0.01  # [rad] before a stop, where each joint reverses so that backlash is taken up
_JERK_PEAK = 1.875  # peak over mean speed of a minimum-jerk move
_LEAST_MOVE = 0.05  # [s]
_ACCELERATION = 5.0  # [rad/s^2] of a Delta's joints at the beginning and the end of a path


@dataclass(frozen=True)
class MotionPath:
    """A path that is measured in motion: nominal joints at a constant time step.

    It begins and ends at rest: acceleration and braking add to the duration.
    """

    name: str
    joint: Array  # (k, m) [rad or m]
    duration: float  # [s]


@dataclass(frozen=True)
class Plan:
    """A measurement plan: stops in their order, then paths."""

    name: str
    target: Array  # (n, 3) [m] nominal tool point in the base
    joint: Array  # (n, m) [rad or m] nominal
    direction: Array  # (n,) +1 or -1: the side from which all joints approach
    payload: Array  # (n,) [kg]
    dwell: float  # [s] at each stop
    paths: tuple[MotionPath, ...] = ()

    @classmethod
    def around(
        cls,
        name: str,
        target: Array,
        joint: Array,
        sides: Sequence[float],
        dwell: float,
        payload: float = 0.0,
        paths: tuple[MotionPath, ...] = (),
    ) -> Plan:
        """Plan of different places (n, 3), (n, m), each approached from all `sides` in turn."""
        target, joint = (np.repeat(each, len(sides), axis=0) for each in (target, joint))
        direction = np.tile(sides, len(joint) // len(sides))
        return cls(name, target, joint, direction, np.full(len(joint), payload), dwell, paths)

    def __len__(self) -> int:
        return len(self.joint)


@dataclass(frozen=True)
class Leg:
    """One section of a trajectory: the move to a stop and the dwell there, or a path."""

    time: Array  # (k,) [s] since the beginning of the leg
    joint: Array  # (k, m) [rad or m]
    resting: NDArray[np.bool_]  # (k,) whether the command is at rest
    payload: float  # [kg]

    @property
    def started(self) -> NDArray[np.bool_]:
        """Whether motion has begun at each sample, (k,): before, joints hold their last value."""
        off = (self.joint != self.joint[0]).any(axis=1)
        return np.asarray(np.logical_or.accumulate(off))

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Whether each sample is in motion, (k,): the first of a move is still at rest."""
        return np.asarray(self.started & ~self.resting)


def legs(plan: Plan, robot: Robot, rate: float, start: Array | None = None) -> Iterator[Leg]:
    """Convert a plan to motion, sampled at `rate` [1/s]: one leg per stop; two per path."""
    here = plan.joint[0] if start is None else start
    for row in range(len(plan)):
        goal = plan.joint[row]
        short = _short_of(goal, float(plan.direction[row]), robot)
        yield _leg([here, short, goal], robot, rate, plan.dwell, float(plan.payload[row]))
        here = goal
    for path in plan.paths:
        yield _leg([here, path.joint[0]], robot, rate, plan.dwell, float(plan.payload[-1]))
        yield _path_leg(path, robot, rate, plan.dwell, float(plan.payload[-1]))
        here = path.joint[-1]


def _leg(ways: list[Array], robot: Robot, rate: float, dwell: float, payload: float) -> Leg:
    moves = [_minimum_jerk(a, b, robot, rate) for a, b in pairwise(ways)]
    rest = np.repeat(ways[-1][None], max(round(dwell * rate) + 1, 1), axis=0)
    joint = np.concatenate([*moves, rest])
    resting = np.arange(len(joint)) >= len(joint) - len(rest)
    return Leg(np.arange(len(joint)) / rate, joint, resting, payload)


def _path_leg(path: MotionPath, robot: Robot, rate: float, dwell: float, payload: float) -> Leg:
    """Leg of a path in its own duration, or slower if a joint would exceed its speed limit."""
    widest = float(np.abs(np.diff(path.joint, axis=0)).max()) * (len(path.joint) - 1)
    duration = max(path.duration, widest / robot.joints.speed)
    ramp = min(widest / duration / (_ACCELERATION * robot.commanded.joint_size), duration)
    count = max(int(np.ceil((duration + ramp) * rate)) + 1, 2)
    share = (len(path.joint) - 1) * _trapezoid(np.linspace(0, duration + ramp, count), ramp)
    moving = np.column_stack(
        [np.interp(share, np.arange(len(path.joint)), column) for column in path.joint.T]
    )
    rest = np.repeat(moving[-1:], round(dwell * rate) + 1, axis=0)
    joint = np.concatenate([moving, rest])
    return Leg(np.arange(len(joint)) / rate, joint, np.arange(len(joint)) >= count, payload)


def _trapezoid(time: Array, ramp: float) -> Array:
    """Share of a path covered at times from 0 on, with constant speed between two ramps."""
    if ramp == 0:
        return np.asarray(time / time[-1])
    whole = time[-1] - ramp
    up, down = np.minimum(time, ramp), np.minimum(time[-1] - time, ramp)
    constant = np.clip(time - ramp, 0, whole - ramp)
    return np.asarray((up**2 / 2 + constant * ramp + (ramp**2 - down**2) / 2) / (ramp * whole))


def _short_of(goal: Array, direction: float, robot: Robot) -> Array:
    """Joints at which the motion reverses before a stop, (m,) [rad or m]."""
    model = robot.commanded
    back = -direction * APPROACH * model.joint_size * np.ones_like(goal)
    if model.joints != model.task_size:
        back = _together(model, goal[None], back[None])[0] - goal
    return np.clip(goal + back, robot.joints.lower, robot.joints.upper)


def _together(model: Mechanism, joint: Array, way: Array) -> Array:
    """Joints (n, m) moved by about `way` (n, m), such that all of them still belong to a pose."""
    nominal = model.parameters.nominal
    x = model.forward(joint, nominal)
    slope = model.velocity_jacobian(joint, x, nominal)
    moved = x + (slope @ way[..., None])[..., 0]
    return model.inverse(moved[:, : model.task_size], nominal)


def _between(begin: Array, end: Array, share: Array, robot: Robot) -> Array:
    """Joints at shares (k,) of the way from begin to end, (k, m).

    Straight in joint space, or in the pose if there are more joints than degrees of freedom.
    """
    model, nominal = robot.commanded, robot.commanded.parameters.nominal
    if model.joints == model.task_size:
        return np.asarray(begin + share[:, None] * (end - begin))
    first, last = model.forward(np.stack([begin, end]), nominal)[:, : model.task_size]
    return model.inverse(first + share[:, None] * (last - first), nominal)


def _minimum_jerk(begin: Array, end: Array, robot: Robot, rate: float) -> Array:
    """Joints of a minimum-jerk move, without the end point itself, (k, m)."""
    way = float(np.abs(end - begin).max())
    duration = max(way * _JERK_PEAK / robot.joints.speed, _LEAST_MOVE)
    tau = np.arange(max(int(np.ceil(duration * rate)), 1)) / np.ceil(duration * rate)
    share = tau**3 * (10 - 15 * tau + 6 * tau**2)
    return _between(begin, end, share, robot)
