"""Makes the measurement plans by their names."""

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

SEPARATE = "separate"
PLANS = ("line", "disc", "iso9283", "identify", SEPARATE, "circles", "rich")
_FINE = 801  # points of a path: straight lines between them leave the circle by less than 1 um
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
    """Make a plan by name, or read one from a CSV file (see `plan_file.py`).

    Args:
        name_or_csv: `line` (the Delta paper's, x = -y, z = -711 mm), `disc` (same plane),
            `iso9283` (points P1 to P5 of the cube), `identify` (spread over the workspace), `rich`
            (everything a diagnosis needs), `circles` (the circle test), `separate:CAUSE,CAUSE`
            (stops that distinguish two causes; if none are named, play and geometry), or the path
            of a CSV file.
        robot: decides which points are in reach.
        count: number of different points, cycles (`iso9283`) or stops on each circle (`circles`);
            each plan has its own default.
        dwell: at each stop [s].
        both_sides: approach each point from both sides in turn, unless a file states the side.
        radius: of the disc and of the covered part of the workspace [m].
        payload: on the platform [kg], unless a file states it; the second payload, for `rich` and
            `separate`.
        seed: seed of the random points and of the order.

    Raises:
        InputError: no such plan or file, a file of another form, or a count below 1.
        ReachError: a point out of the robot's reach or joint limits, or where cables cannot carry
            the load on the platform.
    """
    if count is not None and count < 1:
        raise InputError(f"count is {count}; it has to be at least 1")
    cycles = count or 30 if name_or_csv == "iso9283" else 0
    if cycles:
        both_sides = False  # the standard's cycle fixes the approach to each pose
    sides = (1.0, -1.0) if both_sides else (1.0,)
    try:
        if name_or_csv.lower().endswith(".csv"):
            if count:
                raise InputError(
                    f"plan {name_or_csv}: the file lists its stops; a count of {count} cannot be "
                    "given with it"
                )
            return read_plan(Path(name_or_csv), robot, dwell, sides, payload)
        if name_or_csv == "rich":
            return _rich(robot, count or 40, dwell, radius, payload or 2.0, seed)
        if name_or_csv.partition(":")[0] == SEPARATE:
            return _separate(name_or_csv, robot, count or 20, dwell, radius, payload or 2.0, seed)
        if name_or_csv == "circles":
            return circles(robot, count, dwell, sides, radius, payload)
        if name_or_csv not in _POINTS:
            raise InputError(
                f"no plan {name_or_csv!r}; there are: {', '.join(PLANS)}, or a CSV file"
            )
        rng = np.random.default_rng(seed)
        targets, turns = _places(name_or_csv, robot, count, radius, rng)
        joint = points.nominal_joints(robot, targets, turns, payload)
        if robot.workspace is not None:  # not every mechanism commands all coordinates of a point
            targets = points.tool_points(robot, joint)
    except ReachError as error:
        raise ReachError(f"plan {name_or_csv}: {error}") from error
    paths = _iso9283_paths(robot, max(cycles // 3, 1), payload) if cycles else ()
    return Plan.around(name_or_csv, targets, joint, sides, dwell, payload, paths)


def causes_in(name: str) -> tuple[str, str]:
    """The two causes in the name of a plan, such as `separate:backlash,joint_zero_offset`.

    Raises:
        InputError: not two names.
    """
    if name == SEPARATE:
        from delta_calibration.effects.catalogue import USUAL_PAIR  # imports all effects

        return USUAL_PAIR
    causes = [cause.strip() for cause in name.partition(":")[2].split(",")]
    if len(causes) != 2 or not all(causes):
        raise InputError(f"plan {name!r}: two causes are expected, as separate:CAUSE,CAUSE")
    return causes[0], causes[1]


def _separate(
    name: str, robot: Robot, count: int, dwell: float, radius: float, payload: float, seed: int
) -> Plan:
    """Make the plan `separate`: the stops that best distinguish two causes."""
    from delta_calibration.plans.parting import part  # imports this module

    causes, reach = causes_in(name), None if robot.workspace is not None else radius
    found = part(robot, causes, count, payload=payload, dwell=dwell, radius=reach, seed=seed)
    if any(level.slot for level in found.levels):
        raise InputError(
            f"plan {name}: these causes are distinguished by stops at several times only; "
            "`delta-cal plan` says when"
        )
    return found.plan


def _places(
    name: str, robot: Robot, count: int | None, radius: float, rng: np.random.Generator
) -> tuple[Array, Array | None]:
    """Tool points of a plan, and rotations; the Delta paper's if the robot has no workspace."""
    if robot.workspace is not None:
        return workspace.places(name, robot, robot.workspace, count, rng)
    return _POINTS[name](robot, count, radius, rng), None


def _iso9283_paths(robot: Robot, cycles: int, payload: float) -> tuple[MotionPath, ...]:
    """The standard's line and large circle, `cycles` times each."""
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
    """Make the plan `rich`: poses from both sides, two payloads, repeats, sweeps, circles."""
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
    """A slow sweep of each joint, and a circle at three speeds in both senses.

    Raises:
        ReachError: a path leaves the reach, or cables cannot carry the payload [kg] on it.
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
