"""`delta-cal info`: show the contents of a session."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.cli.options import SESSION, duration, robots, table
from delta_calibration.recording import inspect_session, joints_in
from delta_calibration.robot import Joints, load_robot
from delta_calibration.wording import moment, spoken


@click.command("info")
@SESSION
@click.option(
    "--robot",
    "robot_file",
    default=None,
    metavar="FILE|NAME",
    shell_complete=robots,
    help="Robot whose joints to look for in each topic.",
)
def command(session: Path, robot_file: str | None) -> None:
    """Show topics, message counts, rates, storage and origin of SESSION."""
    joints = None if robot_file is None else load_robot(robot_file).joints
    info = inspect_session(session)
    click.echo(f"{info.source}: {info.message_count} messages in {duration(info.duration_s)}")
    click.echo(
        f"recorded {moment(info.start_ns)}; {info.storage}, "
        f"{info.compression or 'no'} compression, "
        f"{info.size_bytes / 1e6:.1f} MB" + ("" if info.complete else "; cut off")
    )
    rows = [(t.name, t.type_name, str(t.count), f"{t.rate_hz:.1f}") for t in info.topics]
    click.echo(table(("topic", "type", "messages", "[1/s]"), rows))
    if joints is not None:
        for topic, found in joints_in(session).items():
            click.echo(f"{topic}: {_told(found, joints)}")
    for key, value in info.custom_data.items():
        click.echo(f"{spoken(key)}: {value}")
    for note in info.notes:
        click.echo(f"note: {note}")


def _told(found: tuple[str, ...], joints: Joints) -> str:
    """Which of a message's joints are the robot's, which pass through, and which are others."""
    passed, own = joints.passed_through, joints.names
    kinds = {
        "joints": [name for name in own if name in found],
        "passed through": [name for name in passed if name in found],
        "not the robot's": [name for name in found if name not in own + passed],
        "missing": [name for name in own if name not in found],
    }
    return "; ".join(f"{kind} {', '.join(names)}" for kind, names in kinds.items() if names)
