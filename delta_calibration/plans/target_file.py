"""Targets from a CSV file: where the tool is to be, and how it is to be turned.

    x_mm, y_mm, z_mm                        the tool point, base frame
    turn_x_deg, turn_y_deg, turn_z_deg      how the platform is turned, where the joints command it

A turn is what the mechanism's `task` takes it for: a rotation vector, of an arm from how it holds
its tool at home; of a five-axis machine the angles A and B. A turn that is not given is none.
Coordinates of the place that the joints do not command need no column (z of an arm of two joints,
x of a machine that moves in a plane); one that is there has to say what the rest comes to.
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
_EVERY = (*PLACE, *TURN)
_UNITS = np.array([1e-3] * 3 + [np.pi / 180] * 3)  # SI of one
_SAME = 1e-6  # [m, rad] by which a coordinate may differ from what follows from the others


@dataclass(frozen=True)
class Targets:
    """Where the tool is to be, and the joints that the drawing takes for it."""

    point: Array  # (n, 3) [m]
    turn: Array  # (n, 3) [rad]
    joint: Array  # (n, m) [rad or m]


def commanded_columns(robot: Robot) -> tuple[str, ...]:
    """Columns that a robot's joints command."""
    return tuple(_EVERY[k] for k in robot.commanded.freedoms)


def read_targets(path: Path, robot: Robot) -> Targets:
    """Targets of a CSV file.

    Raises:
        InputError: no such file, a column missing or of another unit, a value that is no finite
            number or cannot be chosen, or no row.
        ReachError: a target out of the robot's reach or joint limits.
    """
    return targets_of(read_rows(path, robot), robot)


def read_rows(path: Path, robot: Robot) -> list[Row]:
    """The lines of a CSV file that has a column for each coordinate of a place that is commanded.

    Raises:
        InputError: no such file, a column missing, there twice or of another unit, a line too
            long, or no line.
    """
    wanted = commanded_columns(robot)
    places = [name for name in wanted if name in PLACE]
    rows = read_table(path, places, [name for name in wanted if name in TURN])
    _require_units(path, tuple(rows[0].text))
    return rows


def targets_of(rows: Sequence[Row], robot: Robot) -> Targets:
    """What lines say, and the joints for it.

    Raises:
        InputError: a value that is no finite number, or that cannot be chosen.
        ReachError: a target out of the robot's reach or joint limits.
    """
    said = np.array([[_said(row, name) for name in _EVERY] for row in rows]) * _UNITS
    wanted = np.nan_to_num(said)
    joint = nominal_joints(robot, wanted[:, :3], wanted[:, 3:])
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


def _said(row: Row, name: str) -> float:
    return row.number(name) if name in row.text else np.nan


def _require_units(path: Path, found: Sequence[str]) -> None:
    """Refuse a column of a place or a turn in another unit."""
    of_stem = {name.rpartition("_")[0]: name for name in _EVERY}
    for name in found:
        meant = of_stem.get(name.rpartition("_")[0], of_stem.get(name, name))
        if meant != name:
            raise InputError(f"{path}: column {name}: not a known unit; allowed: {meant}")
