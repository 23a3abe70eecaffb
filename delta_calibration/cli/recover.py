"""`delta-cal recover`: a recording that was cut off, as one that every reader opens."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.recording.recovery import recover


@click.command("recover", short_help="write a recording that was cut off anew, closed")
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder of the bag to write."
)
def command(bag: Path, out: Path) -> None:
    """Write what can be read of BAG to another bag.

    A recording whose recorder was killed has no index: `ros2 bag`, rosbags' AnyReader and mcap's
    seeking reader refuse it. The new one holds the same messages at the same times, and BAG is
    left as it is.
    """
    found = recover(bag, out)
    for note in found.notes:
        click.echo(f"note: {note}")
    click.echo(f"{found.messages} messages written to {out}")
