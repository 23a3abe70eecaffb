"""Measurement plans: where to stop, from which side, with what load, and the motion between.

A plan is a list of stops and, after them, paths that are measured in motion. `trajectory` turns it
into joint angles over time: a minimum-jerk move to a point short of each stop, another into it, a
dwell.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from delta_calibration.errors import InputError, ReachError
from delta_calibration.iso9283 import Cube
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

LINE_HALF = 0.45  # [m] |x| on the Delta paper's line (15)
PLANE = -0.711  # [m] its height
CUBE = Cube((0.0, 0.0, -0.8), 0.3)  # of ISO 9283, in the most used part of the workspace
_PATH_SPEED = 0.2  # [m/s] on the standard's line and circle
_APPROACH = 0.01  # [rad] how far short of a stop each joint turns round, so that play is taken up
_JERK_PEAK = 1.875  # peak over mean speed of a minimum-jerk move
_LEAST_MOVE = 0.05  # [s]


@dataclass(frozen=True)
class MotionPath:
    """A way that is measured in motion: nominal joints at a constant time step."""

    name: str
    joint: Array  # (k, m) [rad]
    duration: float  # [s]


@dataclass(frozen=True)
class Plan:
    """Stops in the order they are taken, then paths."""

    name: str
    target: Array  # (n, 3) [m] nominal tool point in the base
    joint: Array  # (n, m) [rad] nominal
    direction: Array  # (n,) +1 or -1: the side each joint comes from
    payload: Array  # (n,) [kg]
    dwell: float  # [s] at each stop
    paths: tuple[MotionPath, ...] = ()

    def __len__(self) -> int:
        return len(self.joint)


@dataclass(frozen=True)
class Leg:
    """One piece of a trajectory: a stop with the way to it, or a path."""

    time: Array  # (k,) [s] from the leg's begin
    joint: Array  # (k, m) [rad]
    resting: NDArray[np.bool_]  # (k,) whether the command stands still
    payload: float  # [kg]


def make_plan(
    name_or_csv: str,
    robot: Robot,
    *,
    count: int | None = None,
    dwell: float = 1.0,
    both_sides: bool = True,
    radius: float = 0.45,
    payload: float = 0.0,
    seed: int = 0,
) -> Plan:
    """A plan by name, or the tool points of a CSV file with columns x_mm, y_mm, z_mm.

    Args:
        name_or_csv: `line` (the Delta paper's, x = -y, z = -711 mm), `disc` (same plane),
            `iso9283` (points P1 to P5 of the cube), `identify` (spread over the workspace), `rich`
            (all that a diagnosis wants), or the path of a CSV file.
        robot: decides what can be reached.
        count: of different points; each plan has its own usual number. Cycles, for `iso9283`.
        dwell: at each stop [s].
        both_sides: each point from both sides, one after the other.
        radius: of the disc and of the part of the workspace that is covered [m].
        payload: on the platform [kg]; the second payload, for `rich`.
        seed: of the order and of what is drawn.

    Raises:
        InputError: no such plan or file, or a file of another form.
        ReachError: a point out of the robot's reach or joint limits.
    """
    if name_or_csv.lower().endswith(".csv"):
        targets, name = read_points(Path(name_or_csv)), Path(name_or_csv).stem
    elif name_or_csv in _POINTS:
        name = name_or_csv
        targets = _POINTS[name](robot, count, radius, np.random.default_rng(seed))
    elif name_or_csv == "rich":
        return _rich(robot, count or 40, dwell, radius, payload or 2.0, seed)
    else:
        raise InputError(
            f"no plan {name_or_csv!r}; there are: {', '.join(_POINTS)}, rich, or a CSV file"
        )
    if name == "iso9283":
        both_sides = False  # the standard's cycle fixes the way into each pose
    sides = (1.0, -1.0) if both_sides else (1.0,)
    targets = np.repeat(targets, len(sides), axis=0)
    direction = np.tile(sides, len(targets) // len(sides))
    joint = nominal_joints(robot, targets)
    paths = _iso9283_paths(robot, max((count or 30) // 3, 1)) if name == "iso9283" else ()
    return Plan(name, targets, joint, direction, np.full(len(targets), payload), dwell, paths)


def nominal_joints(robot: Robot, targets: Array) -> Array:
    """Joints that the drawing takes for the tool points, (n, m) [rad].

    Raises:
        ReachError: the first point out of reach or beyond a joint's limit.
    """
    model = robot.model("rotary_delta")
    joint = model.inverse(targets - robot.tool_offset, model.parameters.nominal)
    model.require_reach(joint, targets, "point")
    beyond = (joint < robot.joints.lower) | (joint > robot.joints.upper)
    if beyond.any():
        row, column = np.argwhere(beyond)[0]
        low, high = np.degrees([robot.joints.lower[column], robot.joints.upper[column]])
        raise ReachError(
            f"point {row + 1} needs {robot.joints.names[column]} at "
            f"{np.degrees(joint[row, column]):.1f} degrees; allowed: {low:.1f} to {high:.1f}"
        )
    return joint


def read_points(path: Path) -> Array:
    """Tool points of a CSV file with columns x_mm, y_mm, z_mm, (n, 3) [m].

    Raises:
        InputError: no such file, a column missing, a value that is no finite number, or no row.
    """
    wanted = ("x_mm", "y_mm", "z_mm")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            found = reader.fieldnames or []
            missing = [name for name in wanted if name not in found]
            if missing:
                raise InputError(
                    f"{path}: column {', '.join(missing)} missing; expected {', '.join(wanted)}, "
                    f"found {', '.join(found) or 'nothing'}"
                )
            rows = [
                [_number(path, reader.line_num, name, row[name]) for name in wanted]
                for row in reader
            ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if not rows:
        raise InputError(f"{path}: no points in it")
    return np.array(rows) * 1e-3


def legs(plan: Plan, robot: Robot, rate: float, start: Array | None = None) -> Iterator[Leg]:
    """The plan as motion, sampled at `rate` [1/s]: one leg for each stop, one for each path."""
    here = plan.joint[0] if start is None else start
    for row in range(len(plan)):
        goal = plan.joint[row]
        short = goal - plan.direction[row] * _APPROACH
        yield _leg([here, short, goal], robot, rate, plan.dwell, float(plan.payload[row]))
        here = goal
    for path in plan.paths:
        yield _leg([here, path.joint[0]], robot, rate, plan.dwell, float(plan.payload[-1]))
        yield _path_leg(path, rate, plan.dwell, float(plan.payload[-1]))
        here = path.joint[-1]


def _leg(ways: list[Array], robot: Robot, rate: float, dwell: float, payload: float) -> Leg:
    moves = [
        _minimum_jerk(a, b, robot.joints.speed, rate)
        for a, b in pairwise(ways)
    ]
    rest = np.repeat(ways[-1][None], max(round(dwell * rate) + 1, 1), axis=0)
    joint = np.concatenate([*moves, rest])
    resting = np.arange(len(joint)) >= len(joint) - len(rest)
    return Leg(np.arange(len(joint)) / rate, joint, resting, payload)


def _path_leg(path: MotionPath, rate: float, dwell: float, payload: float) -> Leg:
    count = max(round(path.duration * rate), 2)
    share = np.linspace(0, len(path.joint) - 1, count)
    moving = np.column_stack(
        [np.interp(share, np.arange(len(path.joint)), column) for column in path.joint.T]
    )
    rest = np.repeat(moving[-1:], round(dwell * rate) + 1, axis=0)
    joint = np.concatenate([moving, rest])
    return Leg(np.arange(len(joint)) / rate, joint, np.arange(len(joint)) >= count, payload)


def _minimum_jerk(begin: Array, end: Array, speed: float, rate: float) -> Array:
    """Joints of a move that starts and ends softly, the end itself left out, (k, m)."""
    duration = max(float(np.abs(end - begin).max()) * _JERK_PEAK / speed, _LEAST_MOVE)
    tau = np.arange(max(int(np.ceil(duration * rate)), 1)) / np.ceil(duration * rate)
    share = tau**3 * (10 - 15 * tau + 6 * tau**2)
    return np.asarray(begin + share[:, None] * (end - begin))


def _line(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    x = np.linspace(-LINE_HALF, LINE_HALF, count or 61)
    return np.stack([x, -x, np.full_like(x, PLANE)], axis=1)


def _disc(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """Evenly spread over the disc (sunflower), in the paper's plane."""
    k = np.arange(count or 60) + 0.5
    r, angle = radius * np.sqrt(k / len(k)), np.pi * (1 + np.sqrt(5)) * k
    return np.stack([r * np.cos(angle), r * np.sin(angle), np.full_like(r, PLANE)], axis=1)


def _iso9283(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """Cycles P5, P4, P3, P2, P1 of the standard's cube."""
    return np.tile(CUBE.poses()[::-1], (count or 30, 1))


def _iso9283_paths(robot: Robot, cycles: int) -> tuple[MotionPath, ...]:
    """The standard's line and large circle, each so many times."""
    ways = {"line": CUBE.line(), "circle": CUBE.circle()}
    joints = {name: nominal_joints(robot, points) for name, points in ways.items()}
    lengths = {
        name: float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        for name, points in ways.items()
    }
    return tuple(
        MotionPath(name, joints[name], lengths[name] / _PATH_SPEED)
        for name in ways
        for _ in range(cycles)
    )


def _identify(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """A ring at the rim above and below the paper's plane, the rest spread evenly inside.

    The rim comes first: a calibration holds inside the hull of its poses, and the paper's line
    ends at sqrt(2) times its |x|.
    """
    wanted, widest = count or 60, radius * np.sqrt(2)
    ring = _rim(robot, 1.03 * widest)[:wanted]
    draws = qmc.Halton(3, rng=rng).random(10 * wanted)
    r, angle = widest * np.sqrt(draws[:, 0]), 2 * np.pi * draws[:, 1]
    height = PLANE - 0.15 + 0.25 * draws[:, 2]
    points = np.stack([r * np.cos(angle), r * np.sin(angle), height], axis=1)
    points = np.concatenate([ring, points[_usable(robot, points)]])
    if len(points) < wanted:
        raise InputError(
            f"only {len(points)} of {wanted} points could be placed; choose a smaller radius"
        )
    return points[:wanted]


def _rim(robot: Robot, widest: float) -> Array:
    """The outermost usable points within `widest` of the axis: twelve directions, two heights."""
    angle = np.radians(15 + 30 * np.arange(12))
    radii = np.linspace(widest, 0, 40, endpoint=False)
    rim = []
    for height in (PLANE - 0.05, PLANE + 0.05):
        for a in angle:
            ray = np.stack(
                [radii * np.cos(a), radii * np.sin(a), np.full_like(radii, height)], axis=1
            )
            usable = _usable(robot, ray)
            if usable.any():
                rim.append(ray[np.argmax(usable)])
    return np.array(rim).reshape(-1, 3)


def _usable(robot: Robot, points: Array) -> NDArray[np.bool_]:
    """Points within reach and joint limits, well away from singularities, (n,)."""
    model = robot.model("rotary_delta")
    nominal, x = model.parameters.nominal, points - robot.tool_offset
    joint = model.inverse(x, nominal)
    room = 2 * _APPROACH  # the way into a stop must be within the limits too
    inside = (joint > robot.joints.lower + room) & (joint < robot.joints.upper - room)
    usable = np.asarray(inside.all(axis=1))  # False where out of reach: NaN compares false
    usable[usable] = (
        model.condition(joint[usable], x[usable], nominal) < robot.limits.condition / 2
    )
    return usable


def _rich(
    robot: Robot, count: int, dwell: float, radius: float, payload: float, seed: int
) -> Plan:
    """Poses from both sides with two payloads, shuffled; repeats; sweeps; circles both ways."""
    rng = np.random.default_rng(seed)
    points = _identify(robot, count, radius, rng)
    each = np.array([(row, side) for row in range(count) for side in (1, -1)])
    again = np.array([(row, 1) for row in rng.choice(count, min(10, count), replace=False)] * 3)
    empty, loaded = rng.permutation(np.concatenate([each, again])), rng.permutation(each)
    # The payload is changed three times in the session, not at every stop.
    halves = [np.array_split(stops, 2) for stops in (empty, loaded)]
    blocks = [halves[0][0], halves[1][0], halves[0][1], halves[1][1]]
    stops = np.concatenate(blocks)
    mass = np.repeat([0.0, payload, 0.0, payload], [len(block) for block in blocks])
    row, joint = stops[:, 0], nominal_joints(robot, points)
    return Plan(
        "rich", points[row], joint[row], stops[:, 1].astype(float), mass, dwell, _paths(robot)
    )


def _paths(robot: Robot) -> tuple[MotionPath, ...]:
    """A slow sweep of each joint, and a circle at three speeds both ways round."""
    home = nominal_joints(robot, np.array([[0.0, 0.0, PLANE - 0.05]]))[0]
    sweep = np.concatenate([np.linspace(-0.25, 0.35, 200), np.linspace(0.35, -0.25, 200)])
    paths = [
        MotionPath(f"sweep_{name}", home + sweep[:, None] * np.eye(len(home))[k], 40.0)
        for k, name in enumerate(robot.joints.names)
    ]
    turn = np.linspace(0, 2 * np.pi, 200)
    circle = np.stack(
        [0.2 * np.cos(turn), 0.2 * np.sin(turn), np.full_like(turn, PLANE - 0.05)], axis=1
    )
    around = nominal_joints(robot, circle)
    for duration in (10.0, 5.0, 2.5):
        paths.append(MotionPath(f"circle_{duration:g}_s", around, duration))
        paths.append(MotionPath(f"circle_{duration:g}_s_back", around[::-1], duration))
    return tuple(paths)


def _number(path: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{path}: line {line}: {name}: {text!r} is not a finite number")
    return value


_POINTS: dict[str, Callable[[Robot, int | None, float, np.random.Generator], Array]] = {
    "line": _line,
    "disc": _disc,
    "iso9283": _iso9283,
    "identify": _identify,
}
