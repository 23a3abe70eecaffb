"""`delta-cal compensate`: joint commands that put the tool where it is meant to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.commands_file import (
    UNREACHED,
    Commands,
    unit_for,
    write_commands,
)
from delta_calibration.cli.options import (
    calibration_option,
    progress,
    require_folder,
    robot_option,
    seed_option,
)
from delta_calibration.cli.quantity import CELSIUS, MASS, OfPart
from delta_calibration.cli.tables import TableOptions, table_options
from delta_calibration.compensation import (
    METHODS,
    TABLE,
    CommandStatus,
    Compensated,
    JointCompensator,
    methods_for,
    require_method,
)
from delta_calibration.data import Conditions, at_rest, motion_of
from delta_calibration.effects.catalogue import catalogue
from delta_calibration.errors import DataError, InputError, ReachError
from delta_calibration.plans.target_file import read_rows, targets_of, unused_columns
from delta_calibration.region import Region
from delta_calibration.robot import Robot, load_robot
from delta_calibration.tables import Row

Array = NDArray[np.float64]

_NAMED = 10  # points told one by one
REFUSE, NOMINAL, BLEND = "refuse", "nominal", "blend"
OUTSIDE = (BLEND, NOMINAL, REFUSE)
_BATCH = 64  # commands searched side by side
# Of the length of a vector of three alike normal numbers: its 95 % quantile over its RMS
# (chi with three degrees of freedom, 2.795 / sqrt 3).
_COVERS = 1.614


@click.command("compensate", short_help="joint commands that put the tool where it is meant to be")
@robot_option
@calibration_option("File that `fit` wrote for this robot.", required=True)
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=None,
    help="How corrections are found.  [default: apso; newton where more than three joints are "
    "searched]",
)
@click.argument("targets", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="CSV file to write.")
@click.option(
    "--payload",
    type=MASS,
    default=None,
    metavar="KG",
    help="What the platform will carry at its centre; for a calibration with loads in it.",
)
@click.option(
    "--temperature",
    "temperatures",
    multiple=True,
    metavar="PART=DEGREES",
    type=OfPart(CELSIUS, "arm=27.5"),
    help="How warm a part will be; for a calibration with growth in it. As often as needed.",
)
@click.option(
    "--outside",
    type=click.Choice(OUTSIDE),
    default=BLEND,
    show_default=True,
    help="What cannot be corrected whole: blended out over the margin and nominal beyond it; "
    "nominal from the region's edge on; or refused, and nothing is written.",
)
@click.option(
    "--unit",
    type=click.Choice(("rad", "deg", "mm")),
    default=None,
    help="Of the joints that are written.  [default: rad; mm where joints slide]",
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
    """Correct the joint commands for the tool's places in TARGETS (CSV).

    TARGETS has the columns x_mm, y_mm, z_mm (tool point, base frame) and, where the joints turn
    the platform as well, turn_x_deg, turn_y_deg, turn_z_deg (a rotation vector; of an arm from how
    it holds its tool at home; A and B of a five-axis machine), nothing where a turn is not given.
    What the joints do not command needs no column: an arm of two joints has x_mm, y_mm, a
    five-axis machine y_mm, z_mm, turn_x_deg, turn_y_deg.

    The machine is taken to stop at each point, and to come to it from the one before: play is
    taken back by that direction, and from its middle where a joint has not moved yet.

    Method `table` finds corrections on a grid over the calibrated region first, as many as it
    takes to stay within 1 um between the nodes, and looks them up. Where the calibration holds an
    effect that changes the robot's dimensions from command to command no table can follow; each
    correction is then found exactly, and this is said. The swarm (apso) is for robots with as many
    joints as the coordinates they command, the table for those with three; Newton's method for
    all: where there are more joints, as on a cable robot, the commands are those that fit the
    corrected pose without the joints working against each other.

    Writes a row for every target, in order: its name where it has one, the target as it came, the
    nominal joints (nominal_ before their names), the joints to command, status, u95_mm. Joints
    that turn are in rad under their bare names (--unit deg: _deg behind them), joints that slide
    in _mm. status is `corrected`, `blended` (in the margin beyond the calibrated region, the robot
    file's limits.region_margin_mm) or why there is no correction; such a row has its nominal
    joints, none out of reach, is listed on stderr, and the exit code is 1. u95_mm: within how much
    of the target the tool comes with 95 %, by what the fit leaves open there, how the joints come
    to rest and what the model leaves at places that it had not seen.
    error_mm and, where the joints turn the platform, error_mrad: how far the tool stays from the
    target *by the identified model*; not what a tracker would measure. Columns of axes that the
    robot file passes through (joint_4) stand behind the joints as they came.
    """
    require_folder(out)
    robot = load_robot(robot_file)
    method = method or methods_for(robot.commanded)[0]
    require_method(robot.commanded, method, robot.name)
    options = TableOptions(table_file, table_by, table_bound_um)
    options.require_method(method)
    calibration = load_calibration(calibration_file, robot)
    if outside == NOMINAL:
        calibration = replace(calibration, robot=without_margin(robot))
    warm = warmth_by_part(temperatures, calibration)
    shown = unit_for(robot.joints, unit)
    rows, nominal = _nominal(robot, targets, payload, outside)
    if method == TABLE:
        compensator = options.compensator(calibration, seed)
    else:
        compensator = JointCompensator(calibration, method, seed)
    reached = np.flatnonzero(np.isfinite(nominal).all(axis=1))
    found = None
    if reached.size:
        found = found_for(compensator, nominal[reached], payload, warm, calibration_file)
        if outside == REFUSE:
            _refuse_uncorrected(found, targets, calibration.region)
    radius = np.zeros(0) if found is None else _radius(calibration, found, payload, warm)
    commands = Commands(rows, nominal, found, reached, radius)
    write_commands(out, robot.joints, shown, commands)
    if found is not None:
        tell_of_blended(found, targets, out, reached)
    for cause in calibration.left_out:
        click.echo(f"not compensated: {cause}, as it goes by the clock of the session it was in")
    click.echo(f"written: {out} ({_summary(commands, compensator)})")
    _tell_of_uncorrected(commands, targets, calibration.region)


def _radius(
    calibration: Calibration, found: Compensated, payload: float | None, warm: dict[str, float]
) -> Array:
    """Within how far of their targets corrected commands bring the tool with 95 %, (k,) [m]."""
    identified = calibration.identified
    if identified is None:
        click.echo(
            "u95_mm by the error left alone, the same everywhere: the calibration was written by "
            "an older version; fit again",
            err=True,
        )
        return np.full(len(found.joint), _COVERS * calibration.held_out)
    at = _conditions(found.joint, payload, warm, calibration.robot.commanded.joint_size)
    return identified.radius(at)


def _summary(commands: Commands, compensator: JointCompensator) -> str:
    """How many commands of what were written, and what is left by the model."""
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
        f"{factor * np.abs(found.correction).max():.3f} {unit}; error by the model at most "
        f"{found.model_error[good].max() * 1e3:.2e} mm{turn}, {found.evaluations.mean():.0f} "
        "evaluations each"
    )


def _tell_of_uncorrected(commands: Commands, targets: Path, region: Region) -> None:
    """List every target without a correction once, and fail.

    Raises:
        DataError: there is one.
    """
    bad, status = commands.uncorrected, commands.status
    if not bad:
        return
    reasons = {verdict.name.lower(): verdict.value for verdict in CommandStatus}
    for row in bad:
        left = "no command" if status[row] == UNREACHED else "left nominal"
        click.echo(
            f"{targets}: point {row + 1}{_called(commands.rows[row])}: {left}: "
            f"{reasons[status[row]]}",
            err=True,
        )
    within = ""
    if CommandStatus.OUTSIDE_REGION.name.lower() in status:
        within = f"; the calibrated region lies within {_extent(region)}"
    raise DataError(f"{targets}: {len(bad)} of {len(status)} points are not corrected{within}")


def _called(row: Row) -> str:
    name = row.text.get("name")
    return f" ({name})" if name else ""


def without_margin(robot: Robot) -> Robot:
    """The robot with corrections that end at the calibrated region."""
    return replace(robot, limits=replace(robot.limits, region_margin=0.0))


def corrected(
    compensator: JointCompensator,
    nominal: Array,
    payload: float | None,
    warm: dict[str, float],
    targets: Path,
    calibration_file: Path,
) -> Compensated:
    """All commands (n, m) corrected, the machine stopping at one after the other.

    Raises:
        InputError: the calibration takes a condition that is not given.
        DataError: a command cannot be corrected.
    """
    found = found_for(compensator, nominal, payload, warm, calibration_file)
    _refuse_uncorrected(found, targets, compensator.calibration.region)
    return found


def found_for(
    compensator: JointCompensator,
    nominal: Array,
    payload: float | None,
    warm: dict[str, float],
    calibration_file: Path,
) -> Compensated:
    """What becomes of all commands (n, m), the machine stopping at one after the other.

    Raises:
        InputError: the calibration takes a condition that is not given.
    """
    calibration = compensator.calibration
    at = _conditions(nominal, payload, warm, calibration.robot.commanded.joint_size)
    parts = np.array_split(np.arange(len(nominal)), max(len(nominal) // _BATCH, 1))
    found = Compensated.joined(
        [
            compensator.compensate(nominal[rows], at.take(rows))
            for rows in progress(parts, len(parts), "part")
        ]
    )
    _refuse_unknown(found, calibration_file)
    return found


def _nominal(
    robot: Robot, file: Path, payload: float | None, outside: str
) -> tuple[list[Row], Array]:
    """Targets, and joints that the drawing takes for them, (n, m) [rad or m]; NaN out of reach."""
    rows, load = read_rows(file, robot, robot.joints.passed_through), payload or 0.0
    unused = unused_columns(rows)
    if unused:
        click.echo(f"{file}: not used: {', '.join(unused)} (of a plan)", err=True)
    try:
        return rows, targets_of(rows, robot, load).joint
    except ReachError as error:
        if outside == REFUSE:
            raise ReachError(f"{file}: {error}") from error
    return rows, np.concatenate([_one_nominal(row, robot, load) for row in rows])


def _one_nominal(row: Row, robot: Robot, payload: float) -> Array:
    try:
        return targets_of([row], robot, payload).joint
    except ReachError:
        return np.full((1, len(robot.joints.names)), np.nan)


def warmth_by_part(
    given: Sequence[tuple[str, float]], calibration: Calibration
) -> dict[str, float]:
    """Temperatures [deg C] by part, of parts that the robot has or the calibration goes by.

    Raises:
        InputError: another part, or one twice.
    """
    asked, known = _sensors(calibration)
    by_part: dict[str, float] = {}
    for part, celsius in given:
        if part not in known:
            parts = ", ".join(known) or "none"
            raise InputError(
                f"--temperature {part}={celsius:g}: robot {calibration.robot.name} has no part "
                f"{part!r} that grows; there are: {parts}"
            )
        if part in by_part:
            raise InputError(
                f"--temperature {part}={celsius:g}: {part} is given before as {by_part[part]:g}"
            )
        if part not in asked:
            click.echo(
                f"no growth of {part} in the calibration: --temperature {part}="
                f"{celsius:g} changes nothing",
                err=True,
            )
        by_part[part] = celsius
    return by_part


def _sensors(calibration: Calibration) -> tuple[set[str], list[str]]:
    """Parts whose temperature the calibration goes by, and with them all that can grow."""
    asked = {str(effect.settings.get("sensor", "")) for effect, _ in calibration.live} - {""}
    effects = catalogue(calibration.robot, calibration.chain.mechanism)
    growing = {effect.part for effect in effects if effect.part}
    return asked, sorted(asked | growing)


def _conditions(
    joint: Array, payload: float | None, warm: dict[str, float], joint_size: float
) -> Conditions:
    """Stops at joints (n, m) [rad], one after the other."""
    n = len(joint)
    stops = motion_of(np.arange(n, dtype=float), joint, joint_size)
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
    """The box about a region, in the columns of targets."""
    low, high = 1e3 * region.vertices.min(axis=0), 1e3 * region.vertices.max(axis=0)
    sides = zip("xyz", low, high, strict=True)
    return ", ".join(f"{name} {least:.0f} to {most:.0f}" for name, least, most in sides) + " mm"


def tell_of_blended(
    found: Compensated, targets: Path, out: Path, reached: NDArray[np.intp] | None = None
) -> None:
    """Which points got a part of their correction only, and how far off they stay."""
    reached = np.arange(len(found.joint)) if reached is None else reached
    good = np.array([verdict is CommandStatus.CORRECTED for verdict in found.verdicts])
    share = np.ones(len(found.joint)) if found.share is None else found.share
    blended = np.flatnonzero((share < 1.0) & good)
    if not blended.size:
        return
    click.echo(
        f"{targets}: {blended.size} of {len(share)} points lie in the margin beyond the "
        "calibrated region, where corrections are blended out:",
        err=True,
    )
    for row in blended[:_NAMED]:
        turn = "" if found.model_turn is None else f" and {found.model_turn[row] * 1e3:.3f} mrad"
        click.echo(
            f"  point {reached[row] + 1}: {100 * share[row]:.0f} % of its correction, "
            f"{found.model_error[row] * 1e3:.3f} mm{turn} left by the model",
            err=True,
        )
    if blended.size > _NAMED:
        click.echo(f"  and {blended.size - _NAMED} more: error_mm in {out}", err=True)
