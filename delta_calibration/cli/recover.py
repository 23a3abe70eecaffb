"""`delta-cal recover`: rewrite a cut-off recording as one that every reader opens."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.cli.verb import NEW_FOLDER, verb
from delta_calibration.recording.recovery import recover


@verb("recover")
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--out", type=NEW_FOLDER, required=True, help="Folder of the repaired bag.")
def command(bag: Path, out: Path) -> None:
    """Write all readable messages of BAG to a new bag.

    If the recorder was killed, the bag has no index, and `ros2 bag`, rosbags' AnyReader and mcap's
    seeking reader refuse it. The new bag has the same messages at the same times and an index. BAG
    itself is not changed.
    """
    found = recover(bag, out)
    for note in found.notes:
        click.echo(f"note: {note}")
    click.echo(f"{found.messages} messages written to {out}")
