"""The plans by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError, ReachError
from delta_calibration.plans import points, workspace
from delta_calibration.plans.circles import circles
from delta_calibration.plans.motion import MotionPath, Plan
from delta_calibration.plans.plan_file import read_plan
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

PLANS = ("line", "disc", "iso9283", "identify", "circles", "rich")
_FINE = 801  # points of a path: on the circle the straight lines between stay within 1 um
_PATH_SPEED = 0.2  # [m/s] on the standard's line and circle


def make_plan(
    name_or_csv: str,
    robot: Robot,
    *,
    count: int | None = None,
    dwell: float = 1.0,
    both_sides: bool = True,
    radius: float = points.RADIUS,
    payload: float = 0.0,
    seed: int = 0,
) -> Plan:
    """A plan by name, or one from a CSV file: tool points x_mm, y_mm, z_mm, and what they want.

    Args:
        name_or_csv: `line` (the Delta paper's, x = -y, z = -711 mm), `disc` (same plane),
            `iso9283` (points P1 to P5 of the cube), `identify` (spread over the workspace), `rich`
            (all that a diagnosis wants), `circles` (the circle test of ten minutes), or the path
            of a CSV file.
        robot: decides what can be reached.
        count: of different points; each plan has its own usual number. Cycles, for `iso9283`;
            stops on each circle, for `circles`.
        dwell: at each stop [s].
        both_sides: each point from both sides, one after the other; a file may say otherwise.
        radius: of the disc and of the part of the workspace that is covered [m].
        payload: on the platform [kg], where a file does not say; the second one, for `rich`.
        seed: of the order and of what is drawn.

    Raises:
        InputError: no such plan or file, a file of another form, or a count below 1.
        ReachError: a point out of the robot's reach or joint limits, or at which what is on the
            platform is not borne.
    """
    if count is not None and count < 1:
        raise InputError(f"count is {count}; it has to be at least 1")
    cycles = count or 30 if name_or_csv == "iso9283" else 0
    if cycles:
        both_sides = False  # the standard's cycle fixes the way into each pose
    sides = (1.0, -1.0) if both_sides else (1.0,)
    try:
        if name_or_csv.lower().endswith(".csv"):
            return read_plan(Path(name_or_csv), robot, dwell, sides, payload)
        if name_or_csv == "rich":
            return _rich(robot, count or 40, dwell, radius, payload or 2.0, seed)
        if name_or_csv == "circles":
            return circles(robot, count, dwell, sides, radius, payload)
        if name_or_csv not in _POINTS:
            raise InputError(
                f"no plan {name_or_csv!r}; there are: {', '.join(PLANS)}, or a CSV file"
            )
        rng = np.random.default_rng(seed)
        targets, turns = _places(name_or_csv, robot, count, radius, rng)
        joint = points.nominal_joints(robot, targets, turns, payload)
        if robot.workspace is not None:  # not all of a point is a choice of every mechanism
            targets = points.tool_points(robot, joint)
    except ReachError as error:
        raise ReachError(f"plan {name_or_csv}: {error}") from error
    direction = np.tile(sides, len(targets))
    targets, joint = (np.repeat(each, len(sides), axis=0) for each in (targets, joint))
    paths = _iso9283_paths(robot, max(cycles // 3, 1), payload) if cycles else ()
    mass = np.full(len(targets), payload)
    return Plan(name_or_csv, targets, joint, direction, mass, dwell, paths)


def _places(
    name: str, robot: Robot, count: int | None, radius: float, rng: np.random.Generator
) -> tuple[Array, Array | None]:
    """Tool points of a plan, and turns of the platform; the Delta paper's without a workspace."""
    if robot.workspace is not None:
        return workspace.places(name, robot, robot.workspace, count, rng)
    return _POINTS[name](robot, count, radius, rng), None


def _iso9283_paths(robot: Robot, cycles: int, payload: float) -> tuple[MotionPath, ...]:
    """The standard's line and large circle, each so many times."""
    cube = workspace.cube_of(robot)
    ways = {"line": cube.line(stations=_FINE), "circle": cube.circle(stations=_FINE)}
    joints = {
        name: points.nominal_joints(robot, way, payload=payload) for name, way in ways.items()
    }
    lengths = {
        name: float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
        for name, way in ways.items()
    }
    return tuple(
        MotionPath(name, joints[name], lengths[name] / _PATH_SPEED)
        for name in ways
        for _ in range(cycles)
    )


def _rich(
    robot: Robot, count: int, dwell: float, radius: float, payload: float, seed: int
) -> Plan:
    """Poses from both sides with two payloads, shuffled; repeats; sweeps; circles both ways."""
    rng = np.random.default_rng(seed)
    places, turns = _places("identify", robot, count, radius, rng)
    each = np.array([(row, side) for row in range(count) for side in (1, -1)])
    again = np.array([(row, 1) for row in rng.choice(count, min(10, count), replace=False)] * 3)
    empty, loaded = rng.permutation(np.concatenate([each, again])), rng.permutation(each)
    # The payload is changed three times in the session, not at every stop.
    halves = [np.array_split(stops, 2) for stops in (empty, loaded)]
    blocks = [halves[0][0], halves[1][0], halves[0][1], halves[1][1]]
    stops = np.concatenate(blocks)
    mass = np.repeat([0.0, payload, 0.0, payload], [len(block) for block in blocks])
    row, joint = stops[:, 0], points.nominal_joints(robot, places, turns)
    points.require_borne(robot, joint, "point", payload)
    if robot.workspace is not None:
        places = points.tool_points(robot, joint)
    return Plan(
        "rich",
        places[row],
        joint[row],
        stops[:, 1].astype(float),
        mass,
        dwell,
        motion_paths(robot, payload),
    )


def motion_paths(robot: Robot, payload: float = 0.0) -> tuple[MotionPath, ...]:
    """A slow sweep of each joint, and a circle at three speeds both ways round.

    Raises:
        ReachError: one of them leads out of reach, or where the payload [kg] is not borne.
    """
    if robot.workspace is not None:
        return workspace.paths(robot, robot.workspace, payload)
    home = points.nominal_joints(robot, np.array([[0.0, 0.0, points.PLANE - 0.05]]))[0]
    sweep = np.concatenate([np.linspace(-0.25, 0.35, 200), np.linspace(0.35, -0.25, 200)])
    paths = [
        MotionPath(f"sweep_{name}", home + sweep[:, None] * np.eye(len(home))[k], 40.0)
        for k, name in enumerate(robot.joints.names)
    ]
    for path in paths:
        points.require_limits(robot, path.joint, f"{path.name}: sample")
    turn = np.linspace(0, 2 * np.pi, _FINE)
    circle = np.stack(
        [0.2 * np.cos(turn), 0.2 * np.sin(turn), np.full_like(turn, points.PLANE - 0.05)], axis=1
    )
    around = points.nominal_joints(robot, circle)
    for duration in (10.0, 5.0, 2.5):
        paths.append(MotionPath(f"circle_{duration:g}_s", around, duration))
        paths.append(MotionPath(f"circle_{duration:g}_s_back", around[::-1], duration))
    return tuple(paths)


_POINTS: dict[str, Callable[[Robot, int | None, float, np.random.Generator], Array]] = {
    "line": points.line,
    "disc": points.disc,
    "iso9283": points.iso9283,
    "identify": points.identify,
}
