"""`delta-cal report`: write the page that an engineer signs."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.check import warn_of_mistakes
from delta_calibration.cli.diagnose import TRIED, diagnosed, tried
from delta_calibration.cli.fit import describe_poses
from delta_calibration.cli.making import report_on
from delta_calibration.cli.options import (
    SESSION,
    figures_option,
    in_force_option,
    model_option,
    numbers_option,
    require_folder,
    robot_option,
    seed_option,
    topics_option,
    verbose_option,
)
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.data import collect, survey
from delta_calibration.recording import Topics, read_session
from delta_calibration.report import (
    Report,
    require_libraries,
    write_figures,
    write_numbers,
    write_page,
)
from delta_calibration.robot import load_robot

PATH = click.Path(path_type=Path)


@verb("report")
@SESSION
@robot_option
@click.option("--out", type=OUTPUT, required=True, help="HTML page to write; it opens offline.")
@in_force_option
@click.option(
    "--iso9283",
    "cycles",
    type=PATH,
    default=None,
    metavar="SESSION",
    help="Session with the cycles of the standard (plan iso9283), if SESSION does not contain "
    "them.",
)
@figures_option
@numbers_option
@model_option
@seed_option
@topics_option
@verbose_option(TRIED)
def command(
    session: Path,
    robot_file: str,
    out: Path,
    in_force: Path | None,
    cycles: Path | None,
    figures: Path | None,
    numbers: Path | None,
    model: str | None,
    seed: int,
    topics: tuple[str, ...],
    verbose: bool,
) -> None:
    """Diagnose SESSION and write the result as one HTML page that opens without a network.

    The page starts with the verdict. Below it: the error over the workspace and along the line of
    the Delta paper, what points to the cause, the evidence, what the data cannot determine, noise,
    ISO 9283 if its cycles were recorded, and the origin of every number. Mistakes that `check`
    finds in SESSION are told first.
    """
    require_folder(out)
    require_libraries()
    robot = load_robot(robot_file)
    calibration = None if in_force is None else load_calibration(in_force, robot)
    known = Topics.from_options(topics)
    recorded = read_session(session, known)
    standard = None if cycles is None else (cycles, read_session(cycles, known))
    size = robot.commanded.joint_size
    if standard is not None:  # the session of another robot is refused before the diagnosis
        collect(standard[1], robot.joints.names, size)
    mistakes = warn_of_mistakes(recorded, robot, robot_file, force=False, out=False)
    seen = survey(recorded, robot.joints.names, size)
    click.echo(describe_poses(seen.poses))
    found = diagnosed(seen, robot, model, seed, calibration)
    if verbose:
        click.echo(tried(found, robot.named))
    made = report_on(session, recorded, found, robot, seed, calibration, standard, mistakes)
    click.echo(f"verdict: {made.sentence}")
    write(made, out, figures, numbers)


def write(made: Report, out: Path | None, figures: Path | None, numbers: Path | None) -> None:
    """Write the outputs that were asked for, and print their names."""
    if out is not None:
        write_page(out, made)
        click.echo(f"written: {out}")
    for folder, writer in ((figures, write_figures), (numbers, write_numbers)):
        if folder is not None:
            click.echo(f"written: {len(writer(made, folder))} files in {folder}")
