"""`delta-cal serve`: the bench in a browser, for who opens no terminal."""

from __future__ import annotations

import signal
import sys
import webbrowser
from pathlib import Path

import click

from delta_calibration.errors import InputError

_MEGABYTE = 1 << 20


@click.command("serve", short_help="a page in the browser that does what the verbs do")
@click.option(
    "--data",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("bench"),
    show_default=True,
    help="Folder of everything that is kept: sessions, results, the history.",
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
    help="Address to listen on. Others than the default let other machines in, unencrypted.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8765,
    show_default=True,
    help="Port to listen on; 0 takes a free one.",
)
@click.option(
    "--name",
    "names",
    multiple=True,
    metavar="HOST",
    help="Name by which browsers reach this machine, where that is not the address. As often as "
    "needed.",
)
@click.option(
    "--most",
    type=click.IntRange(min=1),
    default=1024,
    show_default=True,
    metavar="MB",
    help="Largest session that may be dropped, unpacked.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 64),
    default=1,
    show_default=True,
    help="How many sessions are worked on at once.",
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
    """Serve a page on which sessions are dropped, checked, fitted, diagnosed and certified.

    The link that is shown has a token in it; whoever opens it may use the page. What the page does
    are the verbs of this command, and every page says which. Work goes on when a page is closed,
    and goes on with the next start when the server was ended. Ctrl-C ends it.

    Needs Starlette and others: pip install 'delta_calibration[serve]'.
    """
    try:
        from delta_calibration.bench.app import opened, serve, write_door
    except ModuleNotFoundError as error:
        raise InputError(
            f"the page needs {error.name}: pip install 'delta_calibration[serve]'"
        ) from error
    for number in (signal.SIGTERM, signal.SIGHUP):  # to the end, so that the work is ended too
        signal.signal(number, signal.default_int_handler)
    with opened(data, most * _MEGABYTE, workers, cell, store) as bench:

        def tell(link: str) -> None:
            click.echo(f"open in a browser on this machine (Ctrl-C ends it):\n  {link}")
            sys.stdout.flush()
            if show:
                webbrowser.open(write_door(data, link).resolve().as_uri())

        serve(bench, address, port, names, tell)
