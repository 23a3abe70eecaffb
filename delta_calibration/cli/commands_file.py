"""COMMANDS.csv of `compensate`: one row for every target, in the same order, corrected or not.

name                name of the target, if targets have names
x_mm, y_mm, ...     the target as given
nominal_JOINT       joints of the nominal robot for it
JOINT               joints to command: corrected, or nominal if there is no correction
status              corrected, blended, or the reason why it is not (`outside_region`, ...)
u95_mm              95 % radius of the tool about the target; empty if the command is nominal,
because the error of an uncorrected machine is not known
error_mm, error_mrad    remaining error according to the identified model
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.commands import Commands
from delta_calibration.errors import InputError
from delta_calibration.files import written_whole
from delta_calibration.plans.target_file import passed_columns
from delta_calibration.robot import Joints

Array = NDArray[np.float64]

_FACTORS = {"rad": 1.0, "deg": 180.0 / np.pi, "mm": 1e3}
_BARE = "rad"  # unit without a suffix in the names of columns


def unit_for(joints: Joints, asked: str | None) -> str:
    """Unit of the joints in the file.

    Raises:
        InputError: an angle's unit for joints that slide, or a length's for joints that turn.
    """
    fitting = ("mm",) if joints.unit == "m" else ("rad", "deg")
    if asked is None:
        return fitting[0]
    if asked not in fitting:
        moves = "slide" if joints.unit == "m" else "turn"
        raise InputError(
            f"--unit {asked}: the robot's joints {moves}; allowed: {' or '.join(fitting)}"
        )
    return asked


def write_commands(path: Path, joints: Joints, unit: str, commands: Commands) -> None:
    """Write the file, whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    with written_whole(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        columns = _columns(joints, unit, commands)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _columns(joints: Joints, unit: str, commands: Commands) -> dict[str, list[str]]:
    """Texts of every column by the column's name."""
    came = commands.rows[0].text
    columns = {name: [row.text[name] or "" for row in commands.rows] for name in came}
    if "name" in columns:
        columns = {"name": columns.pop("name"), **columns}
    beside = passed_columns(commands.rows, joints.passed_through)
    carried = {name: columns.pop(name) for name in beside}
    sent, left, turn = commands.by_target()
    mark = "" if unit == _BARE else f"_{unit}"
    for before, angles in (("nominal_", commands.nominal), ("", sent)):
        for k, name in enumerate(joints.names):
            own = angles[:, k] * _FACTORS[unit]
            columns[f"{before}{name}{mark}"] = _texts(own, "{:.9f}")
    columns |= carried
    columns["status"] = commands.status
    columns["u95_mm"] = _texts(1e3 * commands.u95(), "{:.4f}")
    columns["error_mm"] = _texts(1e3 * left, "{:.3e}")
    if turn is not None:
        columns["error_mrad"] = _texts(1e3 * turn, "{:.3e}")
    return columns


def _texts(values: Array, form: str) -> list[str]:
    """Format numbers as texts; empty if not finite."""
    return [form.format(value) if np.isfinite(value) else "" for value in values.tolist()]
