"""`delta-cal info`: what a session holds."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.cli.options import SESSION, duration, table
from delta_calibration.recording import inspect_session
from delta_calibration.wording import moment


@click.command("info", short_help="what a session holds")
@SESSION
def command(session: Path) -> None:
    """Topics, counts, rates, storage and provenance of SESSION."""
    info = inspect_session(session)
    click.echo(f"{info.source}: {info.message_count} messages in {duration(info.duration_s)}")
    click.echo(
        f"recorded {moment(info.start_ns)}; {info.storage}, "
        f"{info.compression or 'no'} compression, "
        f"{info.size_bytes / 1e6:.1f} MB" + ("" if info.complete else "; cut off")
    )
    rows = [(t.name, t.type_name, str(t.count), f"{t.rate_hz:.1f}") for t in info.topics]
    click.echo(table(("topic", "type", "messages", "[1/s]"), rows))
    for key, value in info.custom_data.items():
        click.echo(f"{key}: {value}")
    for note in info.notes:
        click.echo(f"note: {note}")
