"""`delta-cal export`: write an identified machine for other controllers."""

from __future__ import annotations

import re
from pathlib import Path

import click

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.compensate import corrected, said, tell_of_blended
from delta_calibration.cli.options import (
    calibration_option,
    payload_option,
    require_folder,
    robot_option,
    temperature_option,
    write_text,
)
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.commands import warmth_by_part
from delta_calibration.compensation import JointCompensator
from delta_calibration.description import describe, urdf
from delta_calibration.documents import write_document
from delta_calibration.errors import InputError, ReachError
from delta_calibration.export import c_files, corrected_points, dh_tables, require_points
from delta_calibration.plans.target_file import read_rows, targets_of
from delta_calibration.robot import load_robot

FORMATS = ("c", "urdf", "dh", "csv")
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)  # identifier in C
_FILE = re.compile(r"[A-Za-z0-9_.-]+")  # file name that a C source can include


@verb("export")
@robot_option
@calibration_option("Calibration file of this robot, from `fit` or `diagnose`.", required=True)
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    required=True,
    help="c: C source and header that correct commands; urdf: the robot with its identified "
    "dimensions; dh: DH tables of a serial arm; csv: a corrected list of points.",
)
@click.option(
    "--points",
    type=click.Path(path_type=Path),
    default=None,
    metavar="TARGETS.csv",
    help="For --format csv: the points, in the form that `compensate` reads.",
)
@payload_option("For --format csv: load at the centre of the platform.")
@temperature_option("For --format csv: temperature of a part; may be repeated.")
@click.option(
    "--prefix",
    default="",
    metavar="NAME_",
    help="For --format c: prefix of every public name, so that one program can hold two machines.",
)
@click.option("--out", type=OUTPUT, required=True, help="File to write.")
def command(
    robot_file: str,
    calibration_file: Path,
    form: str,
    points: Path | None,
    payload: float | None,
    temperatures: tuple[tuple[str, float], ...],
    prefix: str,
    out: Path,
) -> None:
    """Write the identified machine in a form that other controllers can use.

    \b
    c     FILE.c and FILE.h in C99; needs only libm and allocates no memory.
          int correct(const double *q, const conditions *, double *out)
          does the same as `compensate --method newton`, with all effects and
          guards. The header documents joints, units, conditions and return
          codes. Compile with cc -std=c99 -O2, never with -ffast-math.
    urdf  The robot with its identified dimensions and the tracker's frame.
    dh    YAML: the identified parameters of a serial arm as modified and as
          standard DH tables, with signs and the order of multiplication.
    csv   TARGETS.csv with corrected positions; all other columns are kept. A
          controller that only knows the nominal geometry reaches the intended
          points with it. Not for robots with more joints than coordinates.

    The DH tables and the URDF contain the geometry only. They cannot represent effects such as
    backlash, gravity or heat.
    """  # noqa: D301 - to click \b is the control character
    _require_fitting(form, points, payload, temperatures, prefix)
    require_folder(out)
    calibration = load_calibration(calibration_file, load_robot(robot_file))
    if form == "c":
        _write_c(calibration, out, prefix)
    elif form == "urdf":
        write_text(out, urdf(describe(calibration.robot, calibration).tree))
    elif form == "dh":
        write_document(out, dh_tables(calibration))
    elif points is not None:
        _write_points(calibration, calibration_file, points, payload, temperatures, out)
    if form in ("urdf", "dh") and calibration.live:
        causes = ", ".join(calibration.live_causes)
        click.echo(f"not included: {causes}; a {form} file contains the geometry only", err=True)
    if form in ("c", "csv"):
        for cause in calibration.left_out:
            click.echo(
                f"not compensated: {cause}: {calibration.why_left_out(cause)}",
                err=True,
            )
        if calibration.as_it_ended:
            click.echo(calibration.as_it_ended, err=True)
    click.echo(f"written: {out}" + (f" and {out.with_suffix('.h')}" if form == "c" else ""))


def _require_fitting(
    form: str,
    points: Path | None,
    payload: float | None,
    temperatures: tuple[tuple[str, float], ...],
    prefix: str,
) -> None:
    """Refuse options that belong to another format.

    Raises:
        InputError: names the option and the format that it is for.
    """
    of_points = {"--points": points, "--payload": payload, "--temperature": temperatures or None}
    given = [name for name, value in of_points.items() if value is not None]
    if form != "csv" and given:
        raise InputError(f"{given[0]} is for --format csv, not {form}")
    if form == "csv" and points is None:
        raise InputError("--format csv needs --points TARGETS.csv")
    if prefix and form != "c":
        raise InputError(f"--prefix is for --format c, not {form}")
    if prefix and not _NAME.fullmatch(prefix):
        raise InputError(f"--prefix {prefix!r} is not allowed; letters, digits and _ of a C name")


def _write_c(calibration: Calibration, out: Path, prefix: str) -> None:
    """Write the C source, and the header beside it under the same name."""
    if out.suffix != ".c" or not _FILE.fullmatch(out.name):
        raise InputError(
            f"{out}: the name of a C source is expected: letters, digits, . _ - and .c at the end"
        )
    files = c_files(calibration, out.stem, prefix)
    write_text(out.with_suffix(".h"), files.header)
    write_text(out, files.source)


def _write_points(
    calibration: Calibration,
    calibration_file: Path,
    points: Path,
    payload: float | None,
    temperatures: tuple[tuple[str, float], ...],
    out: Path,
) -> None:
    """Write the points with corrected positions."""
    robot = calibration.robot
    require_points(robot)
    warm = warmth_by_part(temperatures, calibration, said)
    rows = read_rows(points, robot, robot.joints.passed_through)
    try:
        nominal = targets_of(rows, robot, payload or 0.0).joint
    except ReachError as error:
        raise ReachError(f"{points}: {error}") from error
    compensator = JointCompensator(calibration)
    found = corrected(compensator, nominal, payload, warm, points, calibration_file)
    write_text(out, corrected_points(robot, rows, found.joint))
    tell_of_blended(found, points, out)
