"""`delta-cal compensate`: joint commands that put the tool where it is meant to be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.commands_file import unit_for, write_commands
from delta_calibration.cli.options import (
    calibration_option,
    payload_option,
    require_folder,
    robot_option,
    seed_option,
    steadily,
    temperature_option,
)
from delta_calibration.cli.tables import TableOptions, table_options
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.commands import (
    UNREACHED,
    Commands,
    commands_for,
    found_for,
    warmth_by_part,
)
from delta_calibration.compensation import (
    METHODS,
    TABLE,
    CommandStatus,
    Compensated,
    JointCompensator,
    methods_for,
    require_method,
)
from delta_calibration.errors import DataError
from delta_calibration.plans.target_file import read_rows, unused_columns
from delta_calibration.region import Region
from delta_calibration.robot import Robot, load_robot
from delta_calibration.tables import Row

Array = NDArray[np.float64]

_NAMED = 10  # points that are listed one by one at most
REFUSE, NOMINAL, BLEND = "refuse", "nominal", "blend"
OUTSIDE = (BLEND, NOMINAL, REFUSE)


@verb("compensate")
@robot_option
@calibration_option("Calibration file of this robot, from `fit` or `diagnose`.", required=True)
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=None,
    help="How corrections are computed.  [default: apso; newton if more than three joints are "
    "searched]",
)
@click.argument("targets", type=click.Path(path_type=Path))
@click.option("--out", type=OUTPUT, required=True, help="CSV file to write.")
@payload_option(
    "Load at the centre of the platform, for a calibration that contains effects of load."
)
@temperature_option(
    "Temperature of a part, for a calibration that contains thermal growth; may be repeated."
)
@click.option(
    "--outside",
    type=click.Choice(OUTSIDE),
    default=BLEND,
    show_default=True,
    help="What to do with targets outside the calibrated region. blend: fade the correction out "
    "over the margin, then send the nominal command; nominal: send the nominal command "
    "everywhere outside; refuse: write nothing if any target cannot be corrected in full.",
)
@click.option(
    "--unit",
    type=click.Choice(("rad", "deg", "mm")),
    default=None,
    help="Unit of the joints in the output.  [default: rad; mm for sliding joints]",
)
@table_options
@seed_option
def command(
    robot_file: str,
    calibration_file: Path,
    method: str | None,
    targets: Path,
    out: Path,
    payload: float | None,
    temperatures: tuple[tuple[str, float], ...],
    outside: str,
    unit: str | None,
    table_file: Path | None,
    table_by: str | None,
    table_bound_um: float | None,
    seed: int,
) -> None:
    """Compute corrected joint commands for the tool positions in TARGETS (CSV).

    TARGETS has the columns x_mm, y_mm, z_mm (tool point in the base frame). If the joints also
    turn the platform, it has turn_x_deg, turn_y_deg, turn_z_deg as well: a rotation vector,
    relative to the tool's orientation at home for an arm, A and B for a five-axis machine; missing
    turns are zero. Coordinates that the joints do not command need no column: an arm of two joints
    has x_mm, y_mm, a five-axis machine y_mm, z_mm, turn_x_deg, turn_y_deg.

    The machine is assumed to stop at each point and to come from the one before. Backlash is
    compensated for that direction of approach; for a joint that has not moved yet, from the middle
    of its play.

    The output has one row for every target, in the same order: name (if given), the target as it
    came, the nominal joints (prefix nominal_), the joints to command, status and u95_mm. Turning
    joints are in rad without a suffix (--unit deg: suffix _deg); sliding joints have the suffix
    _mm. Axes that the robot file passes through (joint_4) are copied behind the joints.

    \b
    status    `corrected`; `blended` in the margin outside the calibrated region
              (limits.region_margin_mm of the robot file); otherwise the reason
              why there is no correction. Such a row has its nominal joints (none
              if out of reach) and is listed on stderr, and the exit code is 1.
    u95_mm    95 % radius of the tool about its target: uncertainty of the fit at
              this place, repeatability of the joints, and the error that the
              model leaves at places it has not seen.
    error_mm  distance to the target *according to the identified model*, not what
              a tracker would measure; error_mrad for the turn of the platform.

    Methods: the swarm (apso) is for robots with as many joints as commanded coordinates, the table
    for those with three of them, newton for all. With more joints than coordinates, as on a cable
    robot, newton gives the commands for the corrected pose in which the joints do not work against
    each other. The table is computed once on a grid over the calibrated region, fine enough for 1
    um between the nodes. If the calibration contains an effect that changes the dimensions from
    command to command, a table cannot follow it; every correction is then computed exactly, and a
    message says so.
    """  # noqa: D301 - to click \b is the control character
    require_folder(out)
    robot = load_robot(robot_file)
    method = method or methods_for(robot.commanded)[0]
    require_method(robot.commanded, method, robot.name)
    options = TableOptions(table_file, table_by, table_bound_um)
    options.require_method(method)
    calibration = load_calibration(calibration_file, robot)
    if outside != BLEND:
        calibration = replace(calibration, robot=without_margin(robot))
    warm = warmth_by_part(temperatures, calibration, said)
    shown = unit_for(robot.joints, unit)
    rows = read_rows(targets, robot, robot.joints.passed_through)
    unused = unused_columns(rows)
    if unused:
        click.echo(f"{targets}: not used: {', '.join(unused)} (columns of a plan)", err=True)
    if method == TABLE:
        compensator = options.compensator(calibration, seed)
    else:
        compensator = JointCompensator(calibration, method, seed)
    commands = commands_for(compensator, rows, payload, warm, calibration_file, said, _watched)
    if outside == REFUSE:
        _tell_of_uncorrected(commands, targets, calibration.region, written=False)
    write_commands(out, robot.joints, shown, commands)
    if commands.found is not None:
        tell_of_blended(commands.found, targets, out, commands.reached)
    for cause in calibration.left_out:
        click.echo(f"not compensated: {cause}: {calibration.why_left_out(cause)}")
    if calibration.as_it_ended:
        click.echo(calibration.as_it_ended)
    click.echo(f"written: {out} ({_summary(commands, compensator)})")
    _tell_of_uncorrected(commands, targets, calibration.region, written=True)


def said(text: str) -> None:
    """Print a note on the result to stderr."""
    click.echo(text, err=True)


def _watched(parts: Sequence[NDArray[np.intp]]) -> Iterable[NDArray[np.intp]]:
    return steadily(parts, len(parts), "part")


def _summary(commands: Commands, compensator: JointCompensator) -> str:
    """Summary: corrected commands, largest correction, and remaining error of the model."""
    found = commands.found
    count = len(commands.rows) - len(commands.uncorrected)
    told = f"{count} of {len(commands.rows)} commands corrected"
    if found is None or not count:
        return told
    good = np.isfinite(found.model_error)
    unit, factor = compensator.calibration.robot.joints.shown
    turn = (
        "" if found.model_turn is None else f" and {found.model_turn[good].max() * 1e3:.2e} mrad"
    )
    return (
        f"{told} by {compensator.by}, largest correction "
        f"{factor * np.abs(found.correction).max():.3f} {unit}; remaining error according to the "
        f"model at most {found.model_error[good].max() * 1e3:.2e} mm{turn}, "
        f"{found.evaluations.mean():.0f} evaluations each"
    )


def _tell_of_uncorrected(
    commands: Commands, targets: Path, region: Region, *, written: bool
) -> None:
    """List every target without a correction, with what was written for it, and fail.

    Raises:
        DataError: a target has no correction.
    """
    bad, status = commands.uncorrected, commands.status
    if not bad:
        return
    reasons = {verdict.name.lower(): verdict.value for verdict in CommandStatus}
    for row in bad:
        left = "no command: " if status[row] == UNREACHED else "left nominal: "
        click.echo(
            f"{targets}: point {row + 1}{_called(commands.rows[row])}: {left * written}"
            f"{reasons[status[row]]}",
            err=True,
        )
    within = ""
    if CommandStatus.OUTSIDE_REGION.name.lower() in status:
        within = f"; the calibrated region lies within {_extent(region)}"
    what = "are not corrected" if written else "cannot be corrected, and nothing was written"
    raise DataError(f"{targets}: {len(bad)} of {len(status)} points {what}{within}")


def _called(row: Row) -> str:
    name = row.text.get("name")
    return f" ({name})" if name else ""


def without_margin(robot: Robot) -> Robot:
    """Robot without a margin: its corrections end at the edge of the calibrated region."""
    return replace(robot, limits=replace(robot.limits, region_margin=0.0))


def corrected(
    compensator: JointCompensator,
    nominal: Array,
    payload: float | None,
    warm: dict[str, float],
    targets: Path,
    calibration_file: Path,
) -> Compensated:
    """Correct all commands (n, m) of a machine that stops at one after the other.

    Raises:
        InputError: a condition that the calibration needs is not given.
        DataError: a command cannot be corrected.
    """
    found = found_for(compensator, nominal, payload, warm, calibration_file, _watched)
    _refuse_uncorrected(found, targets, compensator.calibration.region)
    return found


def _refuse_uncorrected(found: Compensated, targets: Path, region: Region) -> None:
    bad = [
        row for row, verdict in enumerate(found.verdicts) if verdict is not CommandStatus.CORRECTED
    ]
    if bad:
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        reason = found.verdicts[bad[0]].value
        if found.verdicts[bad[0]] is CommandStatus.OUTSIDE_REGION:
            reason += f", which lies within {_extent(region)} and the joint angles measured there"
        raise DataError(
            f"{targets}: point {bad[0] + 1} cannot be corrected: {reason}{more}; "
            "nothing was written"
        )


def _extent(region: Region) -> str:
    """Bounding box of a region as text, by the axes of the targets."""
    low, high = 1e3 * region.vertices.min(axis=0), 1e3 * region.vertices.max(axis=0)
    sides = zip("xyz", low, high, strict=True)
    return ", ".join(f"{name} {least:.0f} to {most:.0f}" for name, least, most in sides) + " mm"


def tell_of_blended(
    found: Compensated, targets: Path, out: Path, reached: NDArray[np.intp] | None = None
) -> None:
    """Print which points get only a part of their correction, and their remaining errors."""
    reached = np.arange(len(found.joint)) if reached is None else reached
    good = np.array([verdict is CommandStatus.CORRECTED for verdict in found.verdicts])
    share = np.ones(len(found.joint)) if found.share is None else found.share
    blended = np.flatnonzero((share < 1.0) & good)
    if not blended.size:
        return
    click.echo(
        f"{targets}: {blended.size} of {len(share)} points are in the margin outside the "
        "calibrated region, where corrections fade out:",
        err=True,
    )
    for row in blended[:_NAMED]:
        turn = "" if found.model_turn is None else f" and {found.model_turn[row] * 1e3:.3f} mrad"
        click.echo(
            f"  point {reached[row] + 1}: {100 * share[row]:.0f} % of its correction, remaining "
            f"error {found.model_error[row] * 1e3:.3f} mm{turn} according to the model",
            err=True,
        )
    if blended.size > _NAMED:
        click.echo(f"  and {blended.size - _NAMED} more: error_mm in {out}", err=True)
