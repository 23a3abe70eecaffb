"""Circle test with a telescoping ballbar: reads its lengths and the commands from a table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.circle_test.circles import Circle, find_circles
from delta_calibration.data import Conditions, at_rest, motion_of
from delta_calibration.data.motion import largest_around
from delta_calibration.diagnosis import Judgement, diagnose_observations
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation import Measured, RadiusMeasured
from delta_calibration.geometry import Frame
from delta_calibration.plans import joints_toward, require_limits, tool_points
from delta_calibration.robot import Robot
from delta_calibration.tables import Row, read_table
from delta_calibration.texts import read_text

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TIME, RADIUS, POINT = "time_s", "radius_mm", ("x_mm", "y_mm", "z_mm")
_MOST_MM = 1e5
_MOST_S = 1e9
_RESTING, _AROUND = 0.1, 0.5  # at rest below this share of the top speed within this time [s]
_MOST_READINGS = 360  # of a motion, from twice as many on it is thinned
_ASTRAY = 0.2  # share of the commanded radius; a length farther off belongs to another circle


@dataclass(frozen=True)
class Ballbar:
    """A ballbar's lengths on circles, in order of time."""

    source: str
    at: Conditions  # (n) with the commanded joints
    radius: Array  # (n,) [m]
    path: Index  # (n,) number of the motion
    circles: tuple[Circle, ...]

    @property
    def pivot(self) -> Array:
        """Approximate position of the ball on the table, in the base frame, (3,) [m]."""
        return np.asarray(np.mean([circle.centre for circle in self.circles], axis=0))


def read_ballbar(path: Path, robot: Robot) -> Ballbar:
    """Read the table of a ballbar: `time_s`, `radius_mm`, and the commands.

    The commands are a column for each joint by its name [rad, m], or the tool point in the base
    (`x_mm`, `y_mm`, `z_mm`). Only circles are used, each thinned to fewer than 720 readings.

    Raises:
        InputError: names file, line, column and value that is wrong, and what is allowed.
        DataError: no circle in the table.
    """
    names = robot.joints.names
    head = read_text(path).partition("\n")[0]
    by_points = all(name in head for name in POINT)
    if not by_points and not any(name in head for name in names):
        raise InputError(
            f"{path}: no columns of the command: {', '.join(names)} or {', '.join(POINT)} "
            f"beside {TIME} and {RADIUS}; found {head.strip() or 'nothing'}"
        )
    rows = read_table(path, (TIME, RADIUS, *(POINT if by_points else names)))
    time = np.array([row.number(TIME, -_MOST_S, _MOST_S) for row in rows])
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        raise rows[late[0] + 1].wrong(TIME, "is not allowed; later than the line before")
    radius = 1e-3 * np.array([row.number(RADIUS, 0.0, _MOST_MM) for row in rows])
    joint = _points(rows, robot) if by_points else _joints(rows, robot)
    tool = tool_points(robot, joint)
    path_number, moving = _motions(time, tool)
    kept = _thinned(path_number, moving)
    found = find_circles(time[kept], tool[kept], path_number[kept])
    if not found:
        raise DataError(
            f"{path}: no circle in it: one turn of 340 degrees or more at a constant feed is "
            "needed, a stop before and after"
        )
    rows_of = np.concatenate([kept[circle.rows] for circle in found])
    ends = np.cumsum([0, *(len(circle.rows) for circle in found)])
    circles = tuple(
        replace(circle, rows=np.arange(begin, end))
        for circle, begin, end in zip(found, ends[:-1], ends[1:], strict=True)
    )
    _require_near(rows, rows_of, radius, circles)
    number = np.repeat(np.arange(len(found)), np.diff(ends))
    motion = motion_of(time, joint, robot.commanded.joint_size)
    velocity, acceleration, direction, travel = motion.at(time[rows_of])
    at = replace(
        at_rest(joint[rows_of]),
        time=time[rows_of],
        velocity=velocity,
        acceleration=acceleration,
        direction=direction,
        travel=travel,
    )
    return Ballbar(str(path), at, radius[rows_of], number, circles)


def diagnose_ballbar(ballbar: Ballbar, robot: Robot, noise: float, seed: int) -> Judgement:
    """Diagnose a machine from a ballbar's lengths.

    Args:
        ballbar: circles about one pivot.
        robot: nominal dimensions and priors.
        noise: standard deviation of a length [m].
        seed: seed of the bootstraps.
    """
    radius = RadiusMeasured(ballbar.at.joint, ballbar.radius, robot.tool_offset, noise)
    taken = Measured(
        radius, ballbar.at, path=ballbar.path, repeatability=robot.joints.repeatability
    )
    frame = Frame(np.eye(3), -ballbar.pivot)
    return diagnose_observations([taken], robot.detailed, robot, frame, seed=seed)


def _joints(rows: list[Row], robot: Robot) -> Array:
    names = robot.joints.names
    joint = np.array([[row.number(name) for name in names] for row in rows])
    for row, one in zip(rows, joint, strict=True):
        wrong = robot.joints.beyond(one)
        if wrong:
            raise InputError(f"{row.file}: line {row.line}: {wrong}; rad or m are expected")
    return joint


def _points(rows: list[Row], robot: Robot) -> Array:
    targets = [[row.number(name, -_MOST_MM, _MOST_MM) for name in POINT] for row in rows]
    joint = joints_toward(robot, 1e-3 * np.array(targets))
    lost = np.flatnonzero(~np.isfinite(joint).all(axis=1))
    if lost.size:
        row = rows[lost[0]]
        raise InputError(
            f"{row.file}: line {row.line}: the point "
            f"{', '.join(f'{v:g}' for v in targets[lost[0]])} mm is out of reach of {robot.name}"
        )
    require_limits(robot, joint, f"{rows[0].file}: point")
    return joint


def _motions(time: Array, tool: Array) -> tuple[Index, NDArray[np.bool_]]:
    """Number of the motion of each sample (n,), and whether the tool moves there (n,)."""
    if len(time) < 3:
        return np.zeros(len(time), dtype=np.int64), np.zeros(len(time), dtype=bool)
    speed = np.linalg.norm(np.gradient(tool, time, axis=0), axis=1)
    period = float(np.median(np.diff(time)))
    fastest = largest_around(speed, int(_AROUND / period))
    moving = speed > _RESTING * np.maximum(fastest, 1e-9)
    broken = np.r_[True, (np.diff(moving.astype(int)) != 0) | (np.diff(time) > _AROUND)]
    return np.cumsum(broken) - 1, moving


def _thinned(path: Index, moving: NDArray[np.bool_]) -> Index:
    """Rows of the samples in motion, each motion thinned to less than 2 `_MOST_READINGS`."""
    every = [np.flatnonzero((path == number) & moving) for number in np.unique(path)]
    return np.concatenate([rows[:: max(1, len(rows) // _MOST_READINGS)] for rows in every])


def _require_near(rows: list[Row], of: Index, radius: Array, circles: tuple[Circle, ...]) -> None:
    for circle in circles:
        far = np.abs(radius[of[circle.rows]] - circle.radius) > _ASTRAY * circle.radius
        if far.any():
            row = rows[of[circle.rows[np.flatnonzero(far)[0]]]]
            raise row.wrong(
                RADIUS, f"is not allowed; the command has radius {1e3 * circle.radius:.1f} mm"
            )
