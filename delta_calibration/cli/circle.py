"""`delta-cal circle`: how round the circles of a session are, why not, and what to do first."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from delta_calibration.circle_test import CircleTest, Measured, Share, circle_test
from delta_calibration.cli.check import warn_of_mistakes
from delta_calibration.cli.diagnose import describe, diagnosed
from delta_calibration.cli.fit import describe_poses
from delta_calibration.cli.options import (
    SESSION,
    model_option,
    require_folder,
    robot_option,
    seed_option,
    table,
    topics_option,
    write_json,
)
from delta_calibration.recording import Topics, read_session
from delta_calibration.report import (
    circle_report,
    require_libraries,
    session_provenance,
    write_page,
)
from delta_calibration.report.circles import advice, called
from delta_calibration.robot import load_robot
from delta_calibration.samples import survey

_FILE = click.Path(path_type=Path)
_UM = 1e6


@click.command("circle", short_help="how round circles are, why not, and what to do first")
@SESSION
@robot_option
@click.option("--json", "json_file", type=_FILE, default=None, help="Figures to write.")
@click.option(
    "--report",
    "report_file",
    type=_FILE,
    default=None,
    help="HTML page to write, with magnified polar plots; it opens offline.",
)
@model_option
@seed_option
@topics_option
def command(
    session: Path,
    robot_file: str,
    json_file: Path | None,
    report_file: Path | None,
    model: str | None,
    seed: int,
    topics: tuple[str, ...],
) -> None:
    """Say how round the circles in SESSION are, and what takes how much of it.

    The circles are found by what the joints were commanded. Each has its circular deviation G,
    hysteresis H of both senses and radial deviation F, by ISO 230-4. The session is diagnosed as
    `diagnose` does it; a cause's share is what the circles lose without it in the extended model,
    and all shares add up to the deviation. At the end: what to do first, and how round the
    circles are then. A session for it: simulate --plan circles, or the node measurement_plan.
    """
    for path in (json_file, report_file):
        if path is not None:
            require_folder(path)
    if report_file is not None:
        require_libraries()
    robot = load_robot(robot_file)
    recorded = read_session(session, Topics.from_options(topics))
    warn_of_mistakes(recorded, robot, robot_file, force=True, out=False)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    click.echo(describe_poses(seen.poses))
    test = circle_test(recorded, robot, diagnosed(seen, robot, model, seed, None))
    click.echo(describe(test.diagnosis.verdict, named=robot.named))
    click.echo("\n" + described(test, robot.named))
    for text in test.diagnosis.doubts:
        click.echo(f"warning: {text}")
    if json_file is not None:
        write_json(json_file, as_json(test))
        click.echo(f"written: {json_file}")
    if report_file is not None:
        made_of = session_provenance(session, seen.poses, robot, seed, recorded.metadata, None)
        write_page(report_file, circle_report(test, robot, made_of))
        click.echo(f"written: {report_file}")


def described(test: CircleTest, named: Callable[[str], str] = str) -> str:
    """The circles, the shares and what to do first, for people."""
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
    """The verdict, and the circles with what each cause takes of them."""
    first = test.first
    told: dict[str, Any] = {
        **test.diagnosis.verdict.as_dict(),
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
