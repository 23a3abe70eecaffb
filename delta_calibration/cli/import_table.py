"""`delta-cal import`: convert a user's table into a session."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from delta_calibration import __version__
from delta_calibration.cli.options import robot_option, write_json
from delta_calibration.cli.options import table as columns_of
from delta_calibration.cli.quantity import Quantity
from delta_calibration.cli.verb import NEW_FOLDER, OUTPUT, verb
from delta_calibration.documents import write_document
from delta_calibration.errors import CalibrationError, DataError, InputError
from delta_calibration.files import read_bounded
from delta_calibration.recording import write_session
from delta_calibration.recording.presets import Other, mapping_of, overview
from delta_calibration.recording.table_guess import Guess, guessed
from delta_calibration.recording.table_mapping import (
    LENGTHS,
    TableMapping,
    mapping_from,
    read_mapping,
)
from delta_calibration.recording.table_session import session_of_table
from delta_calibration.robot import Robot, load_robot

_FILE = click.Path(path_type=Path)


def _list_presets(context: click.Context, _option: click.Parameter, asked: bool) -> None:
    if asked:
        click.echo(columns_of(("preset", "gives", "what it is"), overview(), left=3))
        context.exit()


@verb("import")
@click.argument("table", type=_FILE)
@click.option(
    "--mapping",
    "mapping_file",
    type=_FILE,
    default=None,
    metavar="YAML",
    help="YAML file that says what each column is and its unit; see docs/import.md.",
)
@click.option(
    "--preset", default=None, metavar="NAME", help="Known format of TABLE; --presets lists them."
)
@click.option(
    "--guess",
    is_flag=True,
    help="Propose a mapping, and show the first ten rows as it reads them.",
)
@click.option(
    "--presets",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list_presets,
    help="List the known formats and exit.",
)
@click.option(
    "--join",
    "join_file",
    type=_FILE,
    default=None,
    help="Second table to join to TABLE, with --preset or --guess.",
)
@click.option(
    "--join-preset",
    default=None,
    metavar="NAME",
    help="Known format of the second table, with --preset.",
)
@click.option(
    "--by",
    type=click.Choice(["row", "name", "nearest"]),
    default=None,
    help="How rows of the two tables are matched: by row number, by point name, or by nearest "
    "time.  [default: row; with --guess: found from the tables]",
)
@click.option(
    "--within",
    type=Quantity(0.0, 3600.0),
    default=0.05,
    show_default=True,
    help="Largest time difference of matched rows, with --by nearest [s].",
)
@click.option(
    "--shift",
    type=Quantity(-1e10, 1e10),
    default=0.0,
    help="Time to add to the second table's clock [s].",
)
@click.option(
    "--unit",
    type=click.Choice(list(LENGTHS)),
    default=None,
    help="Unit of the points, with --preset.",
)
@click.option(
    "--row-interval",
    type=Quantity(0.0, 86400.0, above=True),
    default=None,
    help="Time from row to row of a table without times [s], with --preset or --guess.  "
    "[default: 10, as an assumption that all results tell]",
)
@click.option(
    "--mapping-out", type=OUTPUT, default=None, help="Write the mapping to this YAML file."
)
@click.option(
    "--json",
    "json_file",
    type=OUTPUT,
    default=None,
    help="Write what --guess proposes to this JSON file: mapping, first rows, what is in doubt.",
)
@robot_option
@click.option("--out", type=NEW_FOLDER, default=None, help="Folder of the session to write.")
def command(
    table: Path,
    mapping_file: Path | None,
    preset: str | None,
    guess: bool,
    join_file: Path | None,
    join_preset: str | None,
    by: str | None,
    within: float,
    shift: float,
    unit: str | None,
    row_interval: float | None,
    mapping_out: Path | None,
    json_file: Path | None,
    robot_file: str,
    out: Path | None,
) -> None:
    """Convert TABLE (CSV or xlsx) into a session that all other verbs can read.

    Each row is one stop: the commanded joints, the measured point or pose and, if the table has
    them, time, encoders, payload, temperatures, side of approach and repeats. Every column has the
    unit given in the mapping. Values that the robot cannot reach in that unit are refused with
    line, column and the more likely unit.

    Give one of three: --mapping, a YAML file that describes the columns; --preset, for tables
    written by known programs; or --guess, which proposes a mapping and shows the first rows. A
    guess writes a session only if nothing about it is in doubt.
    """
    robot = load_robot(robot_file)
    _require_one(mapping_file, preset, guess)
    _require_something(out, mapping_out, guess)
    if json_file is not None and not guess:
        raise InputError("--json needs --guess: the file contains what --guess proposes")
    if unit is not None and preset is None:
        raise InputError("--unit needs --preset: a mapping states the unit of each column")
    if row_interval is not None and mapping_file is not None:
        raise InputError(
            "--row-interval needs --preset or --guess: a mapping states it as row_interval_s"
        )
    doubts = 0
    with TemporaryDirectory() as folder:
        if mapping_file is None:
            mapping_file = mapping_out or Path(folder) / "mapping.yaml"
            if preset is not None:
                other = _other(join_file, join_preset, by, within, shift)
                given = mapping_of(preset, robot, other, unit, mapping_file)
                mapping = _timed(given, row_interval)
            else:
                joined = _second(join_file, join_preset, by, within, shift)
                beside = mapping_file if mapping_out or out else Path("mapping.yaml")
                proposed = guessed(table, robot, joined, beside)
                proposed = replace(proposed, mapping=_timed(proposed.mapping, row_interval))
                if json_file is not None:
                    write_json(json_file, proposed.as_dict())
                read_as = mapping_from(proposed.mapping, beside, robot)
                _show(proposed, table, read_as, robot)
                doubts, mapping = len(proposed.doubts), proposed.mapping
            write_document(mapping_file, dict(mapping))
            _tell_of_mapping(mapping_file, out, mapping_out)
        if out is not None:
            _require_sure(doubts, table, mapping_out)
            _write(table, mapping_file, robot, out)


def _require_one(mapping_file: Path | None, preset: str | None, guess: bool) -> None:
    if sum((mapping_file is not None, preset is not None, guess)) != 1:
        raise InputError(
            "the columns are not described: give one of --mapping, --preset and --guess"
        )


def _require_something(out: Path | None, mapping_out: Path | None, guess: bool) -> None:
    if out is None and mapping_out is None and not guess:
        raise InputError(
            "nothing to write: give --out for the session or --mapping-out for the mapping"
        )


def _timed(mapping: Mapping[str, Any], interval: float | None) -> Mapping[str, Any]:
    """A mapping with the stated interval of the rows [s], if there is one.

    Raises:
        InputError: the rows have times.
    """
    if interval is None:
        return mapping
    if "time" in mapping:
        raise InputError(
            f"--row-interval: the table has times, in column {mapping['time']['column']}"
        )
    return {**mapping, "row_interval_s": interval}


def _other(
    file: Path | None, preset: str | None, by: str | None, within: float, shift: float
) -> Other | None:
    if (file is None) != (preset is None):
        raise InputError(
            "--join and --join-preset must be given together: a second table and its format"
        )
    if file is None or preset is None:
        return None
    return Other(file, preset, by or "row", within, shift)


def _second(
    file: Path | None, preset: str | None, by: str | None, within: float, shift: float
) -> Other | None:
    """Second table for --guess, if one is given."""
    if preset is not None:
        raise InputError(
            "--join-preset needs --preset; --guess finds the format of the second table itself"
        )
    return None if file is None else Other(file, "", by or "", within, shift)


def _show(guess: Guess, table: Path, mapping: TableMapping, robot: Robot) -> None:
    """Print a proposed mapping with its reasons; if in doubt, print an import's notes as well."""
    for text in guess.sure:
        click.echo(text)
    head = tuple(guess.shown[0])
    click.echo()
    click.echo(columns_of(head, [tuple(row.values()) for row in guess.shown], left=0))
    click.echo()
    for text in guess.doubts:
        click.echo(f"in doubt: {text}")
    if guess.doubts:
        for text in _objections(table, mapping, robot):
            click.echo(f"read like this: {text}")


def _require_sure(doubts: int, table: Path, mapping_out: Path | None) -> None:
    """Refuse to write a session by a mapping that is in doubt.

    Raises:
        DataError: something about the mapping is in doubt.
    """
    if not doubts:
        return
    many = "one guess is" if doubts == 1 else f"{doubts} guesses are"
    correct = (
        "write the mapping with --mapping-out, correct it, and import with --mapping"
        if mapping_out is None
        else f"correct the mapping {mapping_out}, and import with --mapping {mapping_out}"
    )
    raise DataError(f"{table}: no session written, because {many} in doubt: {correct}")


def _objections(table: Path, mapping: TableMapping, robot: Robot) -> tuple[str, ...]:
    """Notes of an import by a mapping, or the error by which it refuses the table."""
    try:
        return session_of_table(table, mapping, robot).notes
    except CalibrationError as error:
        return (str(error),)


def _tell_of_mapping(path: Path, out: Path | None, mapping_out: Path | None) -> None:
    """Print where the mapping was written, or the mapping itself if nothing is to be written."""
    if mapping_out is not None:
        click.echo(f"written: {path}")
    elif out is None:
        click.echo("mapping (--mapping-out writes it):")
        click.echo(path.read_text(encoding="utf-8"))


def _write(table: Path, mapping_file: Path, robot: Robot, out: Path) -> None:
    """Write the session of a table by its mapping."""
    session = session_of_table(table, read_mapping(mapping_file, robot), robot)
    tracker = session.tracker
    measured = 0 if tracker is None else len(tracker.stamp_ns)
    if not measured:
        raise InputError(f"{table}: contains no measurements at rest")
    write_session(
        out,
        session,
        {
            "made_by": f"delta-cal import {__version__}",
            "robot": robot.name,
            "robot_sha256": robot.hash,
            "table": table.name,
            "table_sha256": hashlib.sha256(read_bounded(table)).hexdigest(),
            "mapping": mapping_file.name,
        },
    )
    for note in session.notes:
        click.echo(f"note: {note}")
    kind = "points" if tracker is None or tracker.quaternion is None else "poses"
    click.echo(f"written: {out} ({measured} {kind} measured)")
