"""Shared by several verbs: options, formatting of tables and durations, and writing of files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from delta_calibration.cli.quantity import CELSIUS, MASS, OfPart
from delta_calibration.cli.verb import OUTPUTS
from delta_calibration.errors import InputError
from delta_calibration.files import written_whole
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.robot import known_robots

Item = TypeVar("Item")
Function = TypeVar("Function", bound=Callable[..., Any])


def robots(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Shell completion of `--robot`: names of robots, or else files."""
    names = [CompletionItem(name) for name in known_robots() if name.startswith(begun)]
    return names or [CompletionItem(begun, type="file")]  # an item for files would suppress names


SESSION = click.argument("session", type=click.Path(path_type=Path))


def robot_option(function: Function) -> Function:
    """`--robot`: a robot file or name."""
    return _robot_option(function, True, "")


def robot_or_machine_option(function: Function) -> Function:
    """`--robot` of a verb that can take it from a history."""
    return _robot_option(function, False, " Needed without --machine.")


def _robot_option(function: Function, required: bool, more: str) -> Function:
    return click.option(
        "--robot",
        "robot_file",
        required=required,
        metavar="FILE|NAME",
        shell_complete=robots,
        help="Robot file, such as config/srbd.yaml, or the name of a robot of the package, such "
        "as srbd." + more,
    )(function)


def seed_option(function: Function) -> Function:
    """`--seed`."""
    return click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of the random numbers.",
    )(function)


def topics_option(function: Function) -> Function:
    """`--topic`, as often as needed."""
    return click.option(
        "--topic",
        "topics",
        multiple=True,
        metavar="STREAM=TOPIC",
        help="Topic of a stream that was recorded under another name, such as "
        "command=/my/joint_command; may be repeated. Streams: command, states, "
        "tracker_pose, tracker_point, temperature, payload. An empty topic ignores the "
        "stream.",
    )(function)


def model_option(function: Function) -> Function:
    """`--model`."""
    return click.option(
        "--model",
        type=click.Choice(sorted(MECHANISMS)),
        default=None,
        help="Mechanism to fit instead of the one in the robot file.",
    )(function)


def in_force_option(function: Function) -> Function:
    """`--calibration` that was in force during the session, as the baseline."""
    return click.option(
        "--calibration",
        "in_force",
        type=click.Path(path_type=Path),
        default=None,
        help="Calibration that was active during the session. It is compared with the session "
        "instead of the nominal geometry.",
    )(function)


def verbose_option(said: str) -> Callable[[Function], Function]:
    """`-v`; `said` is its help text."""
    return click.option("-v", "--verbose", is_flag=True, help=said)


def figures_option(function: Function) -> Function:
    """`--figures`."""
    return click.option(
        "--figures",
        type=OUTPUTS,
        default=None,
        metavar="FOLDER",
        help="Folder for a PNG file of every figure (needs matplotlib).",
    )(function)


def numbers_option(function: Function) -> Function:
    """`--numbers`."""
    return click.option(
        "--numbers",
        type=OUTPUTS,
        default=None,
        metavar="FOLDER",
        help="Folder for all numbers: report.json, and a CSV file for every figure and table.",
    )(function)


def progress(items: Iterable[Item], total: int, unit: str) -> Iterable[Item]:
    """Progress bar with the time left, shown after one second if stderr is a terminal."""
    from tqdm import tqdm  # imported late: verbs without long work do not need it

    bar: Iterable[Item] = tqdm(items, total=total, unit=unit, delay=1.0, disable=None, leave=False)
    return bar


def steadily(items: Iterable[Item], total: int, unit: str) -> Iterator[Item]:
    """As `progress`, but the bar also appears, with its clock, while the first item takes long."""
    from tqdm import tqdm

    done = Event()
    with tqdm(items, total=total, unit=unit, delay=1.0, disable=None, leave=False) as bar:
        clock = Thread(target=_keep_shown, args=(bar, done), daemon=True)
        clock.start()
        try:
            yield from bar
        finally:
            done.set()
            clock.join()


def _keep_shown(bar: Any, done: Event) -> None:
    """Draw a bar anew every second until the work is done."""
    while not done.wait(1.0):
        bar.refresh()


@contextmanager
def counter(most: int, unit: str) -> Iterator[Callable[[int], object]]:
    """Progress bar for work that reports by a callback how many units it has just done.

    No bar where `most` is 0.
    """
    if not most:
        yield lambda _: None
        return
    from tqdm import tqdm

    with tqdm(total=most, unit=unit, unit_scale=True, delay=1.0, disable=None, leave=False) as bar:
        yield bar.update


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Table as text; the first `left` columns are aligned left, the others right."""
    lines = [tuple(head), *(tuple(row) for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(head))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def duration(seconds: float) -> str:
    """Duration as text, such as `2 h 05 min`, `3 min 20 s` or `12.5 s`."""
    minutes, rest = divmod(seconds, 60)
    if minutes >= 60:
        return f"{int(minutes // 60)} h {int(minutes % 60):02d} min"
    return f"{int(minutes)} min {rest:.0f} s" if minutes else f"{seconds:.1f} s"


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write JSON, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    with written_whole(path) as beside:
        beside.write_text(text, encoding="utf-8")


def calibration_option(said: str, required: bool = False) -> Callable[[Function], Function]:
    """`--calibration`, a file, passed as `calibration_file`; `said` is its help text."""
    return click.option(
        "--calibration",
        "calibration_file",
        type=click.Path(path_type=Path),
        default=None,
        required=required,
        help=said,
    )


def payload_option(said: str) -> Callable[[Function], Function]:
    """Option `--payload`, a mass in kilograms, with the help text `said`."""
    return click.option("--payload", type=MASS, default=None, metavar="KG", help=said)


def temperature_option(said: str) -> Callable[[Function], Function]:
    """Option `--temperature`, once for each part, with the help text `said`."""
    return click.option(
        "--temperature",
        "temperatures",
        multiple=True,
        metavar="PART=DEGREES",
        type=OfPart(CELSIUS, "arm=27.5"),
        help=said,
    )


def write_or_print(out: Path | None, text: str) -> None:
    """Write a text to the file that was asked for, or print it.

    Raises:
        InputError: the file cannot be written, or its folder does not exist.
    """
    if out is None:
        click.echo(text, nl=False)
        return
    require_folder(out)
    write_text(out, text)
    click.echo(f"written: {out}")


def force_option(function: Function) -> Function:
    """`--force`."""
    return click.option(
        "--force",
        is_flag=True,
        help="Write the calibration even if `delta-cal check` finds a mistake in the session, and "
        "replace an existing file of another kind. Errors that are too large for the robot are "
        "refused all the same: the session is another robot's, or joint zeros or units differ.",
    )(function)


def require_folder(path: Path, folder: bool = False) -> None:
    """Refuse an output whose folder does not exist, before any work is done.

    A `Verb` has made the folders of its outputs before.

    Args:
        path: of the output.
        folder: whether it is to be a folder itself.

    Raises:
        InputError: names the folder.
    """
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir() and not folder:
        raise InputError(f"{path}: is a folder; the name of a file is expected")
