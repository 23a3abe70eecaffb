"""Reads targets, positions and rotations of the tool, from a CSV file.

    x_mm, y_mm, z_mm                        the tool point, base frame
    turn_x_deg, turn_y_deg, turn_z_deg      rotation of the platform, if the joints command it

A rotation is interpreted by the mechanism's `task`: as a rotation vector, for an arm from the
orientation of its tool at home; for a five-axis machine as the angles A and B. A missing rotation
is zero. Coordinates of the position that the joints do not command need no column (z of an arm of
two joints, x of a machine that moves in a plane); if there is one, its value must agree with the
commanded coordinates. A plan (plan_file.py) is a target file too: the columns that only a plan
needs are reported, not used. Columns `name` and `note` are for people. Axes that the robot file
passes through may have columns (joint_4, joint_4_deg, ...), which are handed on unchanged if
requested. Any other column is refused, as its content would be ignored silently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.plans.points import nominal_joints, tool_frames
from delta_calibration.robot import Robot
from delta_calibration.tables import Row, read_table

Array = NDArray[np.float64]

PLACE = ("x_mm", "y_mm", "z_mm")
TURN = ("turn_x_deg", "turn_y_deg", "turn_z_deg")
DIRECTION, PAYLOAD, PATH, DURATION = "direction", "payload_kg", "path", "duration_s"
_EVERY = (*PLACE, *TURN)
_OF_A_PLAN = (DIRECTION, PAYLOAD, PATH, DURATION)
NAME, _NOTE = "name", "note"  # for people
_MARKS = ("", "_rad", "_deg", "_m", "_mm")  # suffixes to the name of a passed-through axis
_UNITS = np.array([1e-3] * 3 + [np.pi / 180] * 3)  # factors to SI
_MOST = np.array([1e6] * 3 + [3600.0] * 3)  # [mm], [deg]: a kilometre, ten turns
_SAME = 1e-6  # [m, rad] by which a coordinate may differ from the value implied by the others


@dataclass(frozen=True)
class Targets:
    """Target poses of the tool, and their joints by nominal inverse kinematics."""

    point: Array  # (n, 3) [m]
    turn: Array  # (n, 3) [rad]
    joint: Array  # (n, m) [rad or m]


def commanded_columns(robot: Robot) -> tuple[str, ...]:
    """Columns that a robot's joints command."""
    return tuple(_EVERY[k] for k in robot.commanded.freedoms)


def read_targets(path: Path, robot: Robot, payload: float = 0.0) -> Targets:
    """Read targets from a CSV file, for a payload [kg] on the platform.

    Raises:
        InputError: no such file, a column missing, unknown or of another unit, a value that is no
            finite number or cannot be chosen, or no row.
        ReachError: a target out of the robot's reach or joint limits, or where cables cannot
            carry the load.
    """
    return targets_of(read_rows(path, robot), robot, payload)


def unused_columns(rows: Sequence[Row]) -> tuple[str, ...]:
    """Columns in the file that only a plan needs."""
    return tuple(name for name in _OF_A_PLAN if name in rows[0].text)


def read_rows(path: Path, robot: Robot, passed_through: Sequence[str] = ()) -> list[Row]:
    """Read the rows of a target file; it needs a column for each commanded coordinate.

    Args:
        path: the file.
        robot: its commanded coordinates.
        passed_through: axes that may have a column as well.

    Raises:
        InputError: no such file, a column missing, twice, unknown or of another unit, a line too
            long, no row, or no finite number for an axis that is passed through.
    """
    wanted, beside = commanded_columns(robot), [f"{n}{m}" for n in passed_through for m in _MARKS]
    places = [name for name in wanted if name in PLACE]
    rows = read_table(path, places, [*(name for name in wanted if name in TURN), *beside])
    _require_known(path, tuple(rows[0].text), beside)
    for column in passed_columns(rows, passed_through):
        for row in rows:
            row.number(column)
    return rows


def passed_columns(rows: Sequence[Row], passed_through: Sequence[str]) -> tuple[str, ...]:
    """Columns of axes that are passed through, in the axes' order."""
    return tuple(
        f"{name}{mark}"
        for name in passed_through
        for mark in _MARKS
        if f"{name}{mark}" in rows[0].text
    )


def targets_of(rows: Sequence[Row], robot: Robot, payload: Array | float = 0.0) -> Targets:
    """Convert rows to targets with joints; `payload` on the platform, one for all or (n,) [kg].

    Raises:
        InputError: a value that is no finite number, or that cannot be chosen.
        ReachError: a target out of the robot's reach or joint limits, or where cables cannot
            carry the load.
    """
    bounds = dict(zip(_EVERY, _MOST.tolist(), strict=True))
    said = np.array([[_said(row, *each) for each in bounds.items()] for row in rows]) * _UNITS
    wanted = np.nan_to_num(said)
    joint = nominal_joints(robot, wanted[:, :3], wanted[:, 3:], payload)
    come_to = np.concatenate(tool_frames(robot, joint), axis=1)
    follows = [k for k in range(len(_EVERY)) if k not in robot.commanded.freedoms]
    for k in follows:
        bad = np.flatnonzero(np.abs(said[:, k] - come_to[:, k]) > _SAME)  # none where not said
        if bad.size:
            value = come_to[bad[0], k] / _UNITS[k]
            raise rows[bad[0]].wrong(
                _EVERY[k],
                f"cannot be chosen: robot {robot.name} commands "
                f"{', '.join(commanded_columns(robot))}, by which it is {value:.6g}",
            )
    wanted[:, follows] = come_to[:, follows]
    return Targets(wanted[:, :3], wanted[:, 3:], joint)


def _said(row: Row, name: str, most: float) -> float:
    return row.number(name, -most, most) if name in row.text else np.nan


def _require_known(path: Path, found: Sequence[str], beside: Sequence[str]) -> None:
    """Refuse columns with unknown units or names; those in `beside` are allowed."""
    allowed = (*_EVERY, *_OF_A_PLAN, NAME, _NOTE)
    of_stem = {name.rpartition("_")[0]: name for name in allowed if "_" in name}
    for name in found:
        if name in beside:
            continue
        meant = of_stem.get(name.rpartition("_")[0], of_stem.get(name, name))
        if meant != name:
            raise InputError(f"{path}: column {name}: not a known unit; allowed: {meant}")
        if name not in allowed:
            raise InputError(
                f"{path}: column {name or repr(name)} is not known; allowed: {', '.join(allowed)}"
            )
