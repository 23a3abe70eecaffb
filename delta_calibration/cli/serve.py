"""`delta-cal serve`: the bench as a web page, for users without a terminal."""

from __future__ import annotations

import signal
import sys
import webbrowser
from pathlib import Path

import click

from delta_calibration.errors import InputError

_MEGABYTE = 1 << 20


@click.command("serve")
@click.option(
    "--data",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("bench"),
    show_default=True,
    help="Folder for sessions, results and the history.",
)
@click.option(
    "--store",
    default=None,
    metavar="FILE|URL",
    help="The history, as `delta-cal history` takes it.  [default: history.sqlite in --data]",
)
@click.option(
    "--address",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. Any but the default admits other machines, without encryption.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8766,  # foxglove_bridge, which a cell may run beside it, has 8765
    show_default=True,
    help="Port to listen on; 0 takes a free one.",
)
@click.option(
    "--name",
    "names",
    multiple=True,
    metavar="HOST",
    help="Host name by which browsers reach this machine, if it is not the address; may be "
    "repeated.",
)
@click.option(
    "--most",
    type=click.IntRange(min=1),
    default=1024,
    show_default=True,
    metavar="MB",
    help="Size of the largest session that is accepted, unpacked.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 64),
    default=1,
    show_default=True,
    help="Number of sessions that are processed at once.",
)
@click.option(
    "--cell/--no-cell",
    default=True,
    show_default=True,
    help="Whether to look for a running cell on the ROS domain of this terminal.",
)
@click.option("--open", "show", is_flag=True, help="Open the page in this machine's browser.")
def command(
    data: Path,
    store: str | None,
    address: str,
    port: int,
    names: tuple[str, ...],
    most: int,
    workers: int,
    cell: bool,
    show: bool,
) -> None:
    """Serve a web page that checks, fits, diagnoses and certifies sessions dropped on it.

    The link that is printed contains a token: everyone who has the link can use the page. The page
    runs the verbs of this command, and shows which. Work continues when the page is closed; if the
    server is stopped, it continues at the next start. Ctrl-C stops the server.

    Needs Starlette and others: pip install 'delta_calibration[serve]'.
    """
    try:
        from delta_calibration.bench.app import opened, serve, write_door
    except ModuleNotFoundError as error:
        raise InputError(
            f"the page needs {error.name}: pip install 'delta_calibration[serve]'"
        ) from error
    for number in (signal.SIGTERM, signal.SIGHUP):  # as Ctrl-C, so that running work is ended too
        signal.signal(number, signal.default_int_handler)
    with opened(data, most * _MEGABYTE, workers, cell, store) as bench:

        def tell(link: str) -> None:
            click.echo(f"open in a browser on this machine (Ctrl-C ends it):\n  {link}")
            sys.stdout.flush()
            if show:
                webbrowser.open(write_door(data, link).resolve().as_uri())

        serve(bench, address, port, names, tell)
