"""Reads and writes plans as CSV files: targets, optionally with side, payload and motion.

    x_mm, y_mm, z_mm                the tool point, base frame
    turn_x_deg, ...                 rotation of the platform: see target_file.py
    direction                       1 or -1: the side from which all joints approach
    payload_kg                      on the platform
    path, duration_s                only for points that are passed without a stop: the path's
                                    name, and the duration of the whole path

Only the tool point is required. Stops come first, then paths.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError, ReachError
from delta_calibration.files import written_whole
from delta_calibration.plans.motion import MotionPath, Plan
from delta_calibration.plans.points import tool_frames
from delta_calibration.plans.target_file import (
    DIRECTION,
    DURATION,
    PATH,
    PAYLOAD,
    PLACE,
    TURN,
    commanded_columns,
    read_rows,
    targets_of,
)
from delta_calibration.robot import Robot
from delta_calibration.tables import Row

Array = NDArray[np.float64]

_HEAVIEST = 1e5  # [kg]
_LONGEST = 1e6  # [s] of a path


def read_plan(path: Path, robot: Robot, dwell: float, sides: Sequence[float], mass: float) -> Plan:
    """Read a plan from a file.

    Args:
        path: of the CSV file.
        robot: decides which points are in reach.
        dwell: at each stop [s].
        sides: sides from which each point is approached, if the file states none.
        mass: on the platform [kg], if the file states none.

    Raises:
        InputError: no such file, or one of another form.
        ReachError: a point out of the robot's reach or joint limits.
    """
    rows = read_rows(path, robot)
    on_path = [bool(row.text.get(PATH)) for row in rows]
    count = on_path.index(True) if any(on_path) else len(rows)
    if count == 0:
        raise rows[0].wrong(PATH, "is not preceded by a stop; a plan begins with one")
    if not all(on_path[count:]):
        late = rows[count + on_path[count:].index(False)]
        raise late.wrong(PATH, "is empty after a path; stops come before paths")
    stops = rows[:count]
    if DIRECTION in stops[0].text:
        each, sides = [_direction(row) for row in stops], ()
    else:
        each = list(sides) * count
    again = max(len(sides), 1)
    payload = np.array([_payload(row, mass) for row in stops])
    targets = targets_of(stops, robot, payload)
    return Plan(
        name=path.stem,
        target=np.repeat(targets.point, again, axis=0),
        joint=np.repeat(targets.joint, again, axis=0),
        direction=np.array(each),
        payload=np.repeat(payload, again),
        dwell=dwell,
        paths=tuple(_paths(rows[count:], robot, float(payload[-1]))),
    )


def write_plan(path: Path, plan: Plan, robot: Robot) -> None:
    """Write a plan atomically to a file that `read_plan` can read.

    Raises:
        InputError: the file cannot be written.
    """
    turns = [k for k, name in enumerate(TURN) if name in commanded_columns(robot)]
    head = [*PLACE, *(TURN[k] for k in turns), DIRECTION, PAYLOAD]
    blank = []
    if plan.paths:
        head += [PATH, DURATION]
        blank = ["", ""]
    with written_whole(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        each = zip(
            plan.target,
            tool_frames(robot, plan.joint)[1][:, turns],
            plan.direction,
            plan.payload,
            strict=True,
        )
        for target, turn, side, mass in each:
            place = [*_in_mm(target), *_in_degrees(turn)]
            writer.writerow([*place, f"{side:.0f}", f"{mass:g}", *blank])
        for name, motion in zip(_names(plan.paths), plan.paths, strict=True):
            points, turned = tool_frames(robot, motion.joint)
            for point, turn in zip(points, turned[:, turns], strict=True):
                place = [*_in_mm(point), *_in_degrees(turn)]
                writer.writerow([*place, "", "", name, f"{motion.duration:.6g}"])


def _in_mm(point: Array) -> list[str]:
    return [f"{1e3 * v:.6f}" for v in point]


def _in_degrees(turn: Array) -> list[str]:
    return [f"{v:.9f}" for v in np.degrees(turn)]


def _names(paths: Sequence[MotionPath]) -> Iterator[str]:
    """Names of paths, numbered if the same path is driven several times."""
    seen: dict[str, int] = {}
    for path in paths:
        seen[path.name] = seen.get(path.name, 0) + 1
        yield path.name if seen[path.name] == 1 else f"{path.name}_{seen[path.name]}"


def _direction(row: Row) -> float:
    side = row.number(DIRECTION)
    if side not in (1.0, -1.0):
        raise row.wrong(DIRECTION, "is not allowed; allowed: 1, -1")
    return side


def _payload(row: Row, otherwise: float) -> float:
    if PAYLOAD not in row.text:
        return otherwise
    return row.number(PAYLOAD, 0.0, _HEAVIEST)


def _paths(rows: Sequence[Row], robot: Robot, payload: float) -> Iterator[MotionPath]:
    """Paths in their order, with the payload of the last stop [kg]."""
    for name, group in groupby(rows, key=lambda row: row.text[PATH]):
        way = list(group)
        if DURATION not in way[0].text:
            raise InputError(
                f"{way[0].file}: column {DURATION} missing; a path needs it beside its points"
            )
        duration = way[0].number(DURATION, most=_LONGEST)
        if duration <= 0:
            raise way[0].wrong(DURATION, "is not positive")
        if len(way) < 2:
            raise way[0].wrong(PATH, "has only one point; a path needs at least two")
        for row in way:
            if row.text.get(PAYLOAD) and _payload(row, payload) != payload:
                raise row.wrong(
                    PAYLOAD, f"differs from the {payload:g} of the last stop, which stays on it"
                )
            if row.number(DURATION) != duration:
                raise row.wrong(
                    DURATION, f"differs from the {duration:g} that the path began with"
                )
        try:
            joint = targets_of(way, robot, payload).joint
        except ReachError as error:
            raise ReachError(f"path {name}: {error}") from error
        yield MotionPath(str(name), joint, duration)
