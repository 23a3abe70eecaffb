"""Tell points that were computed from the nominal robot from measured ones."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from delta_calibration.recording.table_found import FoundTable
from delta_calibration.recording.table_placing import Placed
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_CLOSER = 0.1  # of the tracker's noise: a median residual below it is none of measured points
_ROUNDED = 2.0  # typical rounding: a frame through a few rows adds to the residual
_NUMBER = re.compile(r"[+-]?\d*(?:\.(\d*))?(?:[eE]([+-]?\d+))?")


def why_computed(placed: Placed, joint: Array, steps: tuple[Array, Array], named: bool) -> str:
    """How closely points match the nominal robot if they were computed from it; else empty.

    Args:
        placed: fit of the nominal robot to the points.
        joint: (n, m) of the rows.
        steps: (m,) of the joints and (3,) [m] of the points, the last printed digit.
        named: whether the columns' names say that an instrument measured the points; rounding
            then is no sign, because a good robot deviates as little.
    """
    tracker = placed.robot.tracker
    noise = min(tracker.radial, tracker.transverse)
    if placed.typical < _CLOSER * noise:
        return (
            f"match the nominal robot within {1e6 * placed.typical:.2g} um (median); with a "
            f"tracker of {1e6 * noise:.3g} um noise, measured points cannot: they were computed"
        )
    if not named and placed.typical <= _ROUNDED * _rounding(placed.robot, joint, *steps):
        return (
            "match the nominal robot within the rounding of the digits printed: they were "
            "probably computed"
        )
    return ""


def last_digits(table: FoundTable, columns: Sequence[str]) -> Array:
    """Step of the last digit printed in each column, in the column's unit, (columns,)."""
    return np.array(
        [min(_step(table.form.plain(text)) for text in table.texts(name)) for name in columns]
    )


def _step(text: str) -> float:
    match = _NUMBER.fullmatch(text.strip())
    if match is None or not text.strip():
        return np.inf
    digits = int(match[2] or 0) - len(match[1] or "")
    return float(10.0 ** np.clip(digits, -300, 300))


def _rounding(robot: Robot, joint: Array, joint_step: Array, point_step: Array) -> float:
    """Typical distance [m] that rounding of the printed points, and of fine joints, causes.

    All of x, y and z count with the finest digit, because a constant one may have none. Joints are
    counted if their rounding is below the tracker's noise: commands are often exact in a few
    digits, and coarse ones would explain the errors of a good robot.
    """
    model, tracker = robot.commanded, robot.tracker

    def place(q: Array) -> Array:
        return np.asarray(model.position(model.forward(q, model.parameters.nominal)))

    middle = place(joint)
    moved = [place(joint + half) - middle for half in np.diag(joint_step / 2)]
    turned = float(np.median(sum(np.sum(move**2, axis=1) for move in moved))) / 3
    fine = turned < min(tracker.radial, tracker.transverse) ** 2
    return float(np.sqrt((turned if fine else 0.0) + 3 * point_step.min() ** 2 / 12))
