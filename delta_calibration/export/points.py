"""Correct a list of points for a controller that only knows the nominal kinematics.

For a target with nominal command q and correction dq, the corrected point is FK_nominal(q + dq):
the nominal inverse kinematics of the controller turns it into the corrected command q + dq.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError, InputError
from delta_calibration.plans import nominal_joints
from delta_calibration.plans.points import tool_frames
from delta_calibration.plans.target_file import commanded_columns
from delta_calibration.robot import Robot
from delta_calibration.tables import Row

Array = NDArray[np.float64]

_COLUMNS = ("x_mm", "y_mm", "z_mm", "turn_x_deg", "turn_y_deg", "turn_z_deg")
_UNITS = np.array([1e-3] * 3 + [np.pi / 180] * 3)
_SAME = 1e-8  # [joint size] tolerance of a command from the nominal inverse kinematics


def require_points(robot: Robot) -> None:
    """Refuse a robot whose corrected commands cannot be expressed as points.

    Raises:
        InputError: the number of its joints differs from that of the coordinates they command.
    """
    model = robot.commanded
    if model.joints != model.task_size:
        raise InputError(
            f"robot {robot.name}: {model.joints} joints command {model.task_size} coordinates; "
            "a corrected list of points is not possible. `compensate` writes corrected commands, "
            "`export --format c` corrects them in the controller"
        )


def corrected_points(robot: Robot, rows: Sequence[Row], joint: Array) -> str:
    """Text of a target file with corrected coordinates, with the columns in their order.

    Coordinates that the joints do not command, and other columns, are copied unchanged.

    Args:
        robot: robot with the nominal kinematics that the controller uses.
        rows: lines of the target file.
        joint: corrected commands, (n, m) [rad or m].

    Raises:
        InputError: the robot's corrected commands cannot be expressed as points.
        DataError: the nominal inverse kinematics gives another command for a corrected point.
    """
    require_points(robot)
    point, turn = tool_frames(robot, joint)
    _require_back(robot, point, turn, joint)
    said = dict(zip(_COLUMNS, (np.hstack([point, turn]) / _UNITS).T, strict=True))
    commanded = set(commanded_columns(robot))
    head = [*rows[0].text, *(name for name in _COLUMNS if name in commanded - {*rows[0].text})]
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(head)
    for number, row in enumerate(rows):
        writer.writerow(
            [
                f"{said[name][number] + 0.0:.9f}" if name in commanded else row.text[name] or ""
                for name in head
            ]
        )
    return file.getvalue()


def _require_back(robot: Robot, point: Array, turn: Array, joint: Array) -> None:
    again = nominal_joints(robot, point, turn)
    missed = np.abs(again - joint).max(axis=1)
    bad = np.flatnonzero(~(missed <= _SAME * robot.commanded.joint_size))
    if bad.size:
        raise DataError(
            f"point {bad[0] + 1}: the nominal inverse kinematics gives another command for the "
            f"corrected point, {missed[bad[0]]:.3g} {robot.joints.unit} off; `compensate` writes "
            "the command"
        )
