"""`delta-cal iso9283`: how accurate the cell is, by the standard's criteria."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.accuracy import IsoReport, evaluate
from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.options import (
    SESSION,
    calibration_option,
    require_folder,
    robot_option,
    table,
    topics_option,
    write_json,
)
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.data import collect, match
from delta_calibration.iso9283 import DELTA_PAPER, STANDARD
from delta_calibration.recording import Topics, read_session
from delta_calibration.robot import load_robot

_CONDITIONS = {"standard": STANDARD, "delta_paper": DELTA_PAPER}


@verb("iso9283")
@SESSION
@robot_option
@calibration_option(
    "Calibration whose tracker frame is used. Without it the best-fit frame of the same stops is "
    "used, which makes AP look better than it is."
)
@click.option(
    "--conditions",
    type=click.Choice(sorted(_CONDITIONS)),
    default="standard",
    show_default=True,
    help="Number of cycles: 30 / 30 / 10 (the standard), or 25 / 30 / 3 (the Delta paper).",
)
@click.option(
    "--json",
    "json_file",
    type=OUTPUT,
    default=None,
    help="JSON file to write.",
)
@topics_option
def command(
    session: Path,
    robot_file: str,
    calibration_file: Path | None,
    conditions: str,
    json_file: Path | None,
    topics: tuple[str, ...],
) -> None:
    """Compute AP, RP, AD, RD, AT and RT of ISO 9283 from a SESSION of the plan `iso9283`."""
    if json_file is not None:
        require_folder(json_file)
    robot = load_robot(robot_file)
    calibration = None if calibration_file is None else load_calibration(calibration_file, robot)
    recorded = read_session(session, Topics.from_options(topics))
    names, size = robot.joints.names, robot.commanded.joint_size
    report = evaluate(
        collect(recorded, names, size),
        match(recorded, names, size),
        robot,
        _CONDITIONS[conditions],
        calibration,
    )
    click.echo(f"{report.conditions.name}; tracker frame from the {report.frame}")
    rows = [
        (f"{v.symbol} {v.where}", f"{v.value * 1e3:.4f}", str(v.cycles)) for v in report.values
    ]
    click.echo(table(("criterion", "[mm]", "cycles"), rows))
    for sentence in report.left_out:
        click.echo(f"left out: {sentence}")
    if json_file is not None:
        write_json(json_file, _as_json(report))
        click.echo(f"written: {json_file}")


def _as_json(report: IsoReport) -> dict[str, object]:
    conditions = report.conditions
    return {
        "schema": 1,
        "conditions": {
            "name": conditions.name,
            "position_cycles": conditions.position_cycles,
            "distance_cycles": conditions.distance_cycles,
            "path_cycles": conditions.path_cycles,
            "stations": conditions.stations,
        },
        "frame": report.frame,
        "values": [
            {"symbol": v.symbol, "where": v.where, "value_mm": v.value * 1e3, "cycles": v.cycles}
            for v in report.values
        ],
        "left_out": list(report.left_out),
    }
