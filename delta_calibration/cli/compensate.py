"""`delta-cal compensate`: joint commands that put the tool where it is meant to be."""

from __future__ import annotations

import csv
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.options import (
    progress,
    require_folder,
    robot_option,
    seed_option,
)
from delta_calibration.compensation import METHODS, Compensated, JointCompensator, Verdict
from delta_calibration.errors import DataError, InputError, ReachError
from delta_calibration.plans import nominal_joints, read_points
from delta_calibration.robot import Robot, load_robot

Array = NDArray[np.float64]

_BATCH = 64  # commands searched side by side


@click.command("compensate", short_help="joint commands that put the tool where it is meant to be")
@robot_option
@click.option(
    "--calibration", "calibration_file", type=click.Path(path_type=Path), required=True,
    help="File that `fit` wrote for this robot.",
)  # fmt: skip
@click.option("--method", type=click.Choice(METHODS), default="apso", show_default=True)
@click.argument("targets", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="CSV file to write.")
@seed_option
def command(
    robot_file: str, calibration_file: Path, method: str, targets: Path, out: Path, seed: int
) -> None:
    """Correct the joint commands for the tool points in TARGETS (CSV: x_mm, y_mm, z_mm).

    Writes the joints [rad] and error_mm: how far the tool stays from the target *by the identified
    model*; not what a tracker would measure.
    """
    require_folder(out)
    robot = load_robot(robot_file)
    points = read_points(targets)
    calibration = load_calibration(calibration_file, robot)
    compensator = JointCompensator(calibration, method, seed, compiled=len(points) > _BATCH)
    nominal = _nominal(robot, points, targets)
    parts = np.array_split(nominal, max(len(nominal) // _BATCH, 1))
    found = Compensated.joined(
        [compensator.compensate(part) for part in progress(parts, len(parts), "part")]
    )
    _refuse_uncorrected(found, targets)
    _write(out, robot.joints.names, found)
    click.echo(
        f"written: {out} ({len(points)} commands by {method}, largest correction "
        f"{np.degrees(np.abs(found.correction).max()):.3f} degrees; error by the model at most "
        f"{found.model_error.max() * 1e3:.2e} mm, {found.evaluations.mean():.0f} evaluations each)"
    )


def _nominal(robot: Robot, points: Array, targets: Path) -> Array:
    try:
        return nominal_joints(robot, points)
    except ReachError as error:
        raise ReachError(f"{targets}: {error}") from error


def _refuse_uncorrected(found: Compensated, targets: Path) -> None:
    bad = [row for row, verdict in enumerate(found.verdicts) if verdict is not Verdict.CORRECTED]
    if bad:
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        reason = found.verdicts[bad[0]].value
        raise DataError(
            f"{targets}: point {bad[0] + 1} cannot be corrected: {reason}{more}; "
            "nothing was written"
        )


def _write(path: Path, names: tuple[str, ...], found: Compensated) -> None:
    beside = path.with_name(f".{path.name}.part")
    try:
        with beside.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*names, "error_mm"])
            for joint, error in zip(found.joint, found.model_error, strict=True):
                writer.writerow([*(f"{v:.9f}" for v in joint), f"{error * 1e3:.3e}"])
        beside.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
