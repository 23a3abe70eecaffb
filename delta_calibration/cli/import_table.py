"""`delta-cal import`: anyone's table becomes a session."""

from __future__ import annotations

import hashlib
from pathlib import Path

import click

from delta_calibration import __version__
from delta_calibration.cli.options import robot_option
from delta_calibration.errors import InputError
from delta_calibration.files import read_bounded
from delta_calibration.recording import write_session
from delta_calibration.recording.table_mapping import read_mapping
from delta_calibration.recording.table_session import session_of_table
from delta_calibration.robot import load_robot


@click.command("import", short_help="make a session of anyone's table (CSV)")
@click.argument("table", type=click.Path(path_type=Path))
@click.option(
    "--mapping",
    "mapping_file",
    type=click.Path(path_type=Path),
    required=True,
    metavar="YAML",
    help="What the table's columns are, each with its unit; see docs/import.md.",
)
@robot_option
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder of the session to write."
)
def command(table: Path, mapping_file: Path, robot_file: str, out: Path) -> None:
    """Write the rows of TABLE (CSV) as a session that all other verbs read.

    A row is a stop: joints that were commanded, the point or pose that was measured there and,
    where the table has them, time, encoders, payload, temperatures, side and repeats. A column
    has the unit that the mapping says: numbers that the robot cannot reach by it are refused, with
    line, column and the unit they more likely have.
    """
    robot = load_robot(robot_file)
    mapping = read_mapping(mapping_file, robot)
    session = session_of_table(table, mapping, robot)
    tracker = session.tracker
    measured = 0 if tracker is None else len(tracker.stamp_ns)
    if not measured:
        raise InputError(f"{table}: nothing measured at rest in it")
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
