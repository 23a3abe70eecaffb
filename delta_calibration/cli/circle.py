"""`delta-cal circle`: evaluate circles and attribute their deviation to causes."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import click

from delta_calibration.circle_test import (
    CircleTest,
    Measured,
    Share,
    ballbar_test,
    circle_test,
    diagnose_ballbar,
    read_ballbar,
)
from delta_calibration.cli.check import warn_of_mistakes
from delta_calibration.cli.diagnose import TRIED, describe, diagnosed, tried
from delta_calibration.cli.fit import describe_poses
from delta_calibration.cli.options import (
    SESSION,
    model_option,
    require_folder,
    robot_option,
    seed_option,
    table,
    topics_option,
    verbose_option,
    write_json,
)
from delta_calibration.cli.quantity import Quantity
from delta_calibration.cli.verb import OUTPUT, OUTPUT_OR_PRINTED, verb
from delta_calibration.data import survey
from delta_calibration.errors import InputError
from delta_calibration.files import read_bounded
from delta_calibration.recording import Topics, read_session
from delta_calibration.report import (
    Provenance,
    circle_report,
    require_libraries,
    session_provenance,
    write_page,
)
from delta_calibration.report.circles import advice, called
from delta_calibration.robot import Robot, load_robot

_UM = 1e6
PRINTED = "-"  # instead of a file name: to standard output
_BALLBAR = 1.0  # [um]


@verb("circle")
@SESSION
@robot_option
@click.option(
    "--json",
    "json_file",
    type=OUTPUT_OR_PRINTED,
    is_flag=False,
    flag_value=PRINTED,
    default=None,
    metavar="[FILE]",
    help="JSON file to write; without a file name the JSON is printed and nothing else.",
)
@click.option(
    "--report",
    "report_file",
    type=OUTPUT,
    default=None,
    help="HTML page to write, with magnified polar plots; it opens offline.",
)
@click.option(
    "--noise-um",
    type=Quantity(0.01, 1000),
    default=None,
    help=f"Standard deviation of a ballbar's length [um]; default {_BALLBAR:g}.",
)
@model_option
@seed_option
@topics_option
@verbose_option(TRIED)
def command(
    session: Path,
    robot_file: str,
    json_file: str | None,
    report_file: Path | None,
    noise_um: float | None,
    model: str | None,
    seed: int,
    topics: tuple[str, ...],
    verbose: bool,
) -> None:
    """Evaluate the circles in SESSION and attribute their deviation to causes.

    Circles are recognised from the joint commands. For each one the circular deviation G, the
    hysteresis H of both senses and the radial deviation F of ISO 230-4 are given. The session is
    diagnosed as by `diagnose`; the share of a cause is the deviation that disappears when the
    cause is removed from the extended model, the mean over all orders of removing, so that the
    shares add up to the deviation. At the end: what to do first, and how round the circles will
    be afterwards. To record a session: simulate --plan circles, or the node measurement_plan.

    SESSION may also be the table of a telescoping ballbar (.csv): time_s, radius_mm, and either a
    column for each joint by its name [rad, m] or x_mm, y_mm, z_mm of the commanded tool point.
    """
    for path in (json_file, report_file):
        if path not in (None, PRINTED):
            require_folder(Path(str(path)))
    if report_file is not None:
        require_libraries()
    robot = load_robot(robot_file)
    is_table = session.suffix.lower() == ".csv"
    if is_table and (model or topics or verbose):
        raise InputError("--model, --topic and -v are for sessions, not for a ballbar's table")
    if not is_table and noise_um is not None:
        raise InputError(
            "--noise-um is for a ballbar's table; the noise of a session is found from its data"
        )
    with redirect_stdout(sys.stderr if json_file == PRINTED else sys.stdout):
        if is_table:
            noise = _BALLBAR if noise_um is None else noise_um
            test, made_of = _of_table(session, robot, noise, seed)
        else:
            test, made_of = _of_session(session, robot, robot_file, model, seed, topics, verbose)
        click.echo("\n" + described(test, robot.named))
        if json_file not in (None, PRINTED):
            write_json(Path(str(json_file)), as_json(test))
            click.echo(f"written: {json_file}")
        if report_file is not None:
            write_page(report_file, circle_report(test, robot, made_of))
            click.echo(f"written: {report_file}")
    if json_file == PRINTED:
        click.echo(json.dumps(as_json(test), indent=2, allow_nan=False))


def _of_session(
    path: Path,
    robot: Robot,
    robot_file: str,
    model: str | None,
    seed: int,
    topics: tuple[str, ...],
    verbose: bool,
) -> tuple[CircleTest, Provenance]:
    recorded = read_session(path, Topics.from_options(topics))
    warn_of_mistakes(recorded, robot, robot_file, force=True, out=False)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    click.echo(describe_poses(seen.poses))
    found = diagnosed(seen, robot, model, seed, None)
    test = circle_test(recorded, robot, found)
    click.echo(describe(found.verdict, named=robot.named))
    for text in found.doubts:
        click.echo(f"warning: {text}")
    if verbose:
        click.echo(tried(found, robot.named))
    made_of = session_provenance(path, seen.poses, robot, seed, recorded.metadata, None)
    return test, made_of


def _of_table(
    path: Path, robot: Robot, noise_um: float, seed: int
) -> tuple[CircleTest, Provenance]:
    ballbar = read_ballbar(path, robot)
    click.echo(f"{path.name}: {len(ballbar.radius)} lengths on {len(ballbar.circles)} circles")
    found = diagnose_ballbar(ballbar, robot, noise_um / _UM, seed)
    click.echo(describe(found.verdict, "length", "length", robot.named))
    made_of = Provenance(
        session=path.name,
        session_sha256=hashlib.sha256(read_bounded(path)).hexdigest(),
        start_ns=0,
        robot=robot.name,
        robot_source=Path(robot.source).name,
        robot_sha256=robot.hash,
        seed=seed,
    )
    return ballbar_test(ballbar, robot, found), made_of


def described(test: CircleTest, named: Callable[[str], str] = str) -> str:
    """Text for the user: the circles, the shares of the causes, and what to do first."""
    circles = [
        (
            f"{m.circle.plane}, {m.circle.sense}",
            f"{1e3 * m.circle.radius:.1f}",
            f"{1e3 * m.circle.feed:.0f}",
            f"{_UM * m.deviation:.1f}",
            "-" if m.hysteresis is None else f"{_UM * m.hysteresis:.1f}",
            f"{_UM * m.radial.min():.1f} to {_UM * m.radial.max():.1f}",
        )
        for m in test.circles
    ]
    head = ("circle", "radius [mm]", "feed [mm/s]", "G [um]", "H [um]", "F [um]")
    shares = [
        (
            named(called(share.cause, share.location)),
            f"{_UM * share.size:.1f}",
            f"{100 * share.size / test.deviation:.0f}",
        )
        for share in test.shares
    ]
    whole = ("all together", f"{_UM * test.deviation:.1f}", "100")
    return "\n".join(
        [
            table(head, circles),
            "",
            table(("mean circular deviation", "[um]", "[%]"), [*shares, whole]),
            "",
            named(f"to do first: {advice(test)}"),
        ]
    )


def as_json(test: CircleTest) -> dict[str, Any]:
    """Verdict, circles and the share of each cause in their deviation, as data for JSON."""
    first = test.first
    told: dict[str, Any] = {
        **test.verdict.as_dict(),
        "circles": [_circle(m) for m in test.circles],
        "deviation_um": _UM * test.deviation,
        "shares": [_share(share, test.deviation) for share in test.shares],
        "first": None,
    }
    if first is not None:
        cause, location = first
        told["first"] = {
            "cause": cause,
            "location": location,
            "deviation_after_um": _UM * test.without(*first),
        }
    return told


def _circle(m: Measured) -> dict[str, Any]:
    return {
        "plane": m.circle.plane,
        "sense": m.circle.sense,
        "radius_mm": 1e3 * m.circle.radius,
        "feed_mm_s": 1e3 * m.circle.feed,
        "readings": len(m.radial),
        "deviation_um": _UM * m.deviation,
        "hysteresis_um": None if m.hysteresis is None else _UM * m.hysteresis,
        "radial_deviation_um": [_UM * float(m.radial.min()), _UM * float(m.radial.max())],
        "shares": [_share(share, m.deviation) for share in m.shares],
        "without": [
            {"cause": cause, "location": location, "deviation_um": _UM * value}
            for (cause, location), value in m.without.items()
        ],
    }


def _share(share: Share, whole: float) -> dict[str, Any]:
    return {
        "cause": share.cause,
        "location": share.location,
        "um": _UM * share.size,
        "share": share.size / whole,
    }
