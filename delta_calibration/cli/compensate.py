"""`delta-cal compensate`: joint commands that put the tool where it is meant to be."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
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
from delta_calibration.cli.tables import TableOptions, table_options
from delta_calibration.compensation import (
    METHODS,
    TABLE,
    Compensated,
    JointCompensator,
    Verdict,
)
from delta_calibration.errors import DataError, InputError, ReachError
from delta_calibration.plans import nominal_joints, read_points
from delta_calibration.robot import Robot, load_robot
from delta_calibration.samples import Conditions, at_rest, motion_of

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
@click.option(
    "--payload", type=click.FloatRange(min=0.0), default=None, metavar="KG",
    help="What the platform will carry at its centre; for a calibration with loads in it.",
)  # fmt: skip
@click.option(
    "--temperature", "temperatures", multiple=True, metavar="PART=DEGREES",
    help="How warm a part will be; for a calibration with growth in it. As often as needed.",
)  # fmt: skip
@table_options
@seed_option
def command(
    robot_file: str,
    calibration_file: Path,
    method: str,
    targets: Path,
    out: Path,
    payload: float | None,
    temperatures: tuple[str, ...],
    table_file: Path | None,
    table_by: str | None,
    table_bound_um: float | None,
    seed: int,
) -> None:
    """Correct the joint commands for the tool points in TARGETS (CSV: x_mm, y_mm, z_mm).

    The machine is taken to stop at each point, and to come to it from the one before: play is
    taken back by that direction, and from its middle where a joint has not moved yet.

    Method `table` finds corrections on a grid over the calibrated region first, as many as it
    takes to stay within 1 um between the nodes, and looks them up. Where the calibration holds an
    effect that changes the robot's dimensions from command to command no table can follow; each
    correction is then found exactly, and this is said.

    Writes the joints [rad] and error_mm: how far the tool stays from the target *by the identified
    model*; not what a tracker would measure.
    """
    require_folder(out)
    options = TableOptions(table_file, table_by, table_bound_um)
    options.require_method(method)
    robot = load_robot(robot_file)
    points = read_points(targets)
    calibration = load_calibration(calibration_file, robot)
    nominal = _nominal(robot, points, targets)
    if method == TABLE:
        compensator = options.compensator(calibration, seed)
    else:
        compensator = JointCompensator(calibration, method, seed, compiled=len(points) > _BATCH)
    at = _conditions(nominal, payload, _by_part(temperatures))
    parts = np.array_split(np.arange(len(nominal)), max(len(nominal) // _BATCH, 1))
    found = Compensated.joined(
        [
            compensator.compensate(nominal[rows], at.take(rows))
            for rows in progress(parts, len(parts), "part")
        ]
    )
    _refuse_unknown(found, calibration_file)
    _refuse_uncorrected(found, targets)
    _write(out, robot.joints.names, found)
    for cause in calibration.left_out:
        click.echo(f"not compensated: {cause}, as it goes by the clock of the session it was in")
    unit, factor = robot.joints.shown
    click.echo(
        f"written: {out} ({len(points)} commands by {compensator.by}, largest correction "
        f"{factor * np.abs(found.correction).max():.3f} {unit}; error by the model at most "
        f"{found.model_error.max() * 1e3:.2e} mm, {found.evaluations.mean():.0f} evaluations each)"
    )


def _nominal(robot: Robot, points: Array, targets: Path) -> Array:
    try:
        return nominal_joints(robot, points)
    except ReachError as error:
        raise ReachError(f"{targets}: {error}") from error


def _by_part(given: Sequence[str]) -> dict[str, float]:
    """Temperatures [deg C] by part."""
    by_part = {}
    for text in given:
        part, _, number = text.partition("=")
        try:
            celsius = float(number)
        except ValueError:
            celsius = np.nan
        if not part or not np.isfinite(celsius):
            raise InputError(f"--temperature {text}: PART=DEGREES is expected, such as arm=27.5")
        by_part[part] = celsius
    return by_part


def _conditions(joint: Array, payload: float | None, warm: dict[str, float]) -> Conditions:
    """Stops at joints (n, m) [rad], one after the other."""
    n = len(joint)
    stops = motion_of(np.arange(n, dtype=float), joint)
    at = replace(at_rest(joint), direction=stops.direction, travel=stops.travel)
    if payload is not None:
        at = replace(at, payload=np.full(n, payload), payload_centre=np.zeros((n, 3)))
    celsius = np.tile(np.array(list(warm.values()), dtype=float), (n, 1))
    return replace(at, temperature_parts=tuple(warm), temperature=celsius)


def _refuse_unknown(found: Compensated, file: Path) -> None:
    if found.missing:
        raise InputError(
            f"{file}: a calibration with effects: {found.missing}; "
            "--payload KG and --temperature PART=DEGREES say it"
        )


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
