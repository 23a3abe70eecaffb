"""`delta-cal compare`: what changed from one calibration or verdict to the next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from delta_calibration.cli.options import (
    figures_option,
    numbers_option,
    require_folder,
    table,
)
from delta_calibration.cli.report import PATH, write
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.errors import InputError
from delta_calibration.report import (
    GLOSSARY,
    Report,
    drift_of_calibrations,
    drift_of_verdicts,
    read_calibration,
    read_verdict,
    require_libraries,
)
from delta_calibration.robot import load_robot

KINDS = (".yaml", ".yml", ".json")


@verb("compare")
@click.argument("files", nargs=-1, required=True, type=PATH)
@click.option(
    "--robot",
    "robot_file",
    default=None,
    metavar="FILE|NAME",
    help="Robot of the calibrations; not needed for verdicts.",
)
@click.option("--out", type=OUTPUT, default=None, help="HTML page to write; it opens offline.")
@figures_option
@numbers_option
def command(
    files: tuple[Path, ...],
    robot_file: str | None,
    out: Path | None,
    figures: Path | None,
    numbers: Path | None,
) -> None:
    """Compare FILES: calibrations (YAML) by the dates of their sessions, or verdicts (JSON).

    For calibrations: how far each machine's tool is from that of the first one at the same joint
    angles, over the region that both cover, independent of where the tracker stood. For
    verdicts: errors, noise and findings, in the order given. A single verdict also makes a page.
    """
    if out is not None:
        require_folder(out)
        require_libraries()
    made = _compared(files, robot_file)
    click.echo(made.sentence)
    for each in made.tables():
        if each.rows and each.name != GLOSSARY:  # its sentences are for the page
            click.echo("\n" + table(each.head, each.rows))
    write(made, out, figures, numbers)


def _compared(files: tuple[Path, ...], robot_file: str | None) -> Report:
    """Compare files of one kind.

    Raises:
        InputError: a file of neither kind, calibrations and verdicts mixed, one calibration only,
            or no robot for them.
    """
    for path in files:
        if path.suffix.lower() not in KINDS:
            raise InputError(
                f"{path}: a calibration (.yaml, of `fit`) or a verdict (.json, of `diagnose`) is "
                "expected"
            )
    verdicts = [path for path in files if path.suffix.lower() == ".json"]
    if len(verdicts) == len(files):
        named = zip(_names(files), files, strict=True)
        return drift_of_verdicts([replace(read_verdict(path), name=name) for name, path in named])
    if verdicts:
        raise InputError(
            f"{verdicts[0]} is a verdict (JSON) and others are calibrations (YAML); "
            "compare files of one kind"
        )
    if len(files) < 2:
        raise InputError(f"{files[0]}: a comparison needs at least two calibrations")
    if robot_file is None:
        raise InputError("comparing calibrations needs the robot: --robot FILE|NAME")
    robot = load_robot(robot_file)
    named = zip(_names(files), files, strict=True)
    return drift_of_calibrations(
        [replace(read_calibration(path, robot), name=name) for name, path in named]
    )


def _names(files: tuple[Path, ...]) -> list[str]:
    """Name of each file in the report: its stem, or its full path if two stems are equal.

    Raises:
        InputError: one file twice.
    """
    if len({path.resolve() for path in files}) < len(files):
        raise InputError("a file is given twice; give different ones")
    stems = [path.stem for path in files]
    return [s if stems.count(s) == 1 else str(p) for s, p in zip(stems, files, strict=True)]
