"""Plans inside the box of a robot file's `workspace`, for any mechanism."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.geometry.halton import halton
from delta_calibration.iso9283 import Cube
from delta_calibration.plans.motion import MotionPath
from delta_calibration.plans.points import (
    CUBE,
    PLACES,
    nominal_joints,
    require_limits,
    usable,
)
from delta_calibration.robot import Robot, Workspace

Array = NDArray[np.float64]

_DRAWS = 20  # draws at most, each of as many places as are needed
_SPAN = 0.8  # share of the box that lines and circles cover
_FINE = 801  # points of a path
_SWEEP = 0.2  # amplitude of a sweep, in units of the mechanism's `joint_size`
_SWEEP_S = 40.0  # [s]
_ROUNDS_S = (10.0, 5.0, 2.5)  # [s] duration of a turn


def places(
    name: str, robot: Robot, box: Workspace, count: int | None, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Tool points (n, 3) [m] of a named plan, and rotations of the platform (n, 3) [rad].

    Raises:
        InputError: the box is too flat for the plan, or too much of it is out of reach.
    """
    if name == "identify":
        return spread(robot, box, count or PLACES, rng)
    if name == "line":
        points = _line(box, count or 61)
    elif name == "disc":
        points = _disc(box, count or 60)
    else:
        points = np.tile(cube(box).poses()[::-1], (count or 30, 1))
    return points, np.zeros_like(points)


def spread(
    robot: Robot, box: Workspace, count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Points and rotations spread evenly over the box, well inside the limits.

    Raises:
        InputError: too much of the box is out of reach.
    """
    found: list[tuple[Array, Array]] = []
    for points, turns in drawn(box, count, rng):
        good = usable(robot, points, turns)
        found.append((points[good], turns[good]))
        if sum(len(points) for points, _ in found) >= count:
            every, turned = (np.concatenate(each)[:count] for each in zip(*found, strict=True))
            return every, turned
    raise InputError(
        f"only {sum(len(points) for points, _ in found)} of {count} points could be placed in the "
        f"workspace of {robot.source}; reduce the workspace or change the limits"
    )


def drawn(box: Workspace, count: int, rng: np.random.Generator) -> Iterator[tuple[Array, Array]]:
    """Yield points [m] and rotations [rad] spread evenly over the box, (count, 3) each."""
    shift = rng.random(6)
    for i in range(_DRAWS):
        share = np.mod(halton(count, 6, i * count) + shift, 1.0) - 0.5
        yield box.centre + share[:, :3] * box.size, 2 * share[:, 3:] * box.turn


def cube_of(robot: Robot) -> Cube:
    """The ISO 9283 cube of a robot: in its workspace, or by default that of the Delta paper.

    Raises:
        InputError: a workspace without volume.
    """
    return CUBE if robot.workspace is None else cube(robot.workspace)


def cube(box: Workspace) -> Cube:
    """The cube of ISO 9283 in the middle of a box.

    Raises:
        InputError: a box without volume.
    """
    edge = _SPAN * float(box.size.min())
    if edge <= 0.0:
        raise InputError("the cube of ISO 9283 needs a workspace with extents along x, y and z")
    x, y, z = box.centre.tolist()
    return Cube((x, y, z), edge)


def paths(robot: Robot, box: Workspace, payload: float) -> tuple[MotionPath, ...]:
    """A slow sweep of each joint that can move alone; a circle at three speeds, both senses."""
    model = robot.commanded
    home = nominal_joints(robot, box.centre[None])[0]
    found = []
    if model.joints == model.task_size:  # otherwise no joint can move alone
        out = _SWEEP * model.joint_size * np.linspace(-1.0, 1.0, 200)
        sweep = np.concatenate([out, out[::-1]])[:, None]
        for k, name in enumerate(robot.joints.names):
            joint = home + sweep * np.eye(len(home))[k]
            require_limits(robot, joint, f"sweep_{name}: sample")
            found.append(MotionPath(f"sweep_{name}", joint, _SWEEP_S))
    around = nominal_joints(robot, _circle(box), payload=payload)
    for duration in _ROUNDS_S:
        found.append(MotionPath(f"circle_{duration:g}_s", around, duration))
        found.append(MotionPath(f"circle_{duration:g}_s_back", around[::-1], duration))
    return tuple(found)


def _wide(box: Workspace) -> Array:
    """Unit vectors along the box's extents, the widest first, (3, 3)."""
    return np.asarray(np.eye(3)[np.argsort(-box.size, kind="stable")])


def _line(box: Workspace, count: int) -> Array:
    way = _SPAN * np.linspace(-0.5, 0.5, count)[:, None]
    return np.asarray(box.centre + way * _wide(box)[0] * box.size.max())


def _disc(box: Workspace, count: int) -> Array:
    """Points (sunflower) over the ellipse in the two widest extents, sorted by angle."""
    k = np.arange(count) + 0.5
    r, angle = np.sqrt(k / count), np.mod(np.pi * (1 + np.sqrt(5)) * k, 2 * np.pi)
    r, angle = r[np.argsort(angle)], np.sort(angle)
    return _around(box, r, angle)


def _circle(box: Workspace) -> Array:
    angle = np.linspace(0.0, 2 * np.pi, _FINE)
    return _around(box, np.full_like(angle, 0.5), angle)


def _around(box: Workspace, r: Array, angle: Array) -> Array:
    first, second, _ = _wide(box)
    half = _SPAN * box.size / 2
    across = r[:, None] * (
        np.cos(angle)[:, None] * first * half + np.sin(angle)[:, None] * second * half
    )
    return np.asarray(box.centre + across)
