"""`delta-cal history`: sessions of a machine kept together, and what changed between them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from delta_calibration.cli.check import warn_of_mistakes
from delta_calibration.cli.diagnose import diagnosed
from delta_calibration.cli.options import (
    progress,
    require_folder,
    robot_option,
    seed_option,
    table,
    topics_option,
    write_text,
)
from delta_calibration.data import survey
from delta_calibration.errors import InputError
from delta_calibration.history import Dated, History, find_changes
from delta_calibration.recording import Topics, read_session
from delta_calibration.report import require_libraries, write_page
from delta_calibration.report.history import page_of_history
from delta_calibration.robot import Robot, load_robot
from delta_calibration.wording import mm, plain

if TYPE_CHECKING:  # other verbs do not wait for a database's library
    from delta_calibration.history.store import Entry, Store

FILE = click.Path(path_type=Path)
STORE = click.option(
    "--store",
    "url",
    default="history.sqlite",
    show_default=True,
    metavar="FILE|URL",
    help="The history: a file of SQLite, or a database as SQLAlchemy names it.",
)
_MACHINE = click.option("--machine", required=True, metavar="NAME", help="Which machine.")


@click.group("history", short_help="keep sessions of a machine, and tell what changed and when")
def command() -> None:
    """Keep the sessions of a machine together, and tell what changed between them.

    Needs SQLAlchemy: pip install 'delta_calibration[history]'.
    """


@command.command("add")
@click.argument("sessions", nargs=-1, required=True, type=FILE)
@robot_option
@_MACHINE
@STORE
@click.option(
    "--id", "name", default=None, help="Of a single session.  [default: its folder's name]"
)
@click.option(
    "--quick", is_flag=True, help="Fit the geometry only; no causes are looked for, no verdict."
)
@seed_option
@topics_option
def add(
    sessions: tuple[Path, ...],
    robot_file: str,
    machine: str,
    url: str,
    name: str | None,
    quick: bool,
    seed: int,
    topics: tuple[str, ...],
) -> None:
    """Diagnose SESSIONS and add them to the history of a machine, with calibration and verdict.

    The bags stay where they are: the history knows their paths and their hashes. What was added
    before an error stays added.
    """
    robot = load_robot(robot_file)
    if name is not None and len(sessions) > 1:
        raise InputError(f"--id {name}: of a single session; {len(sessions)} are given")
    for session in sessions:
        if not session.is_dir():
            raise InputError(f"{session}: no folder of a session")
    given = str(Path(robot_file).resolve()) if Path(robot_file).is_file() else robot_file
    with opened(url, make=True) as store:
        for session in sessions:
            path = session.resolve()
            _add(store, machine, path, name or path.name, robot, given, topics, seed, quick)
        known = len(store.sessions(machine))
    click.echo(f"{url}: {machine} has {known} session{'' if known == 1 else 's'}")


def _add(
    store: Store,
    machine: str,
    path: Path,
    name: str,
    robot: Robot,
    given: str,
    topics: tuple[str, ...],
    seed: int,
    quick: bool,
) -> None:
    """Add one session, or note where it is now."""
    from delta_calibration.history.entries import Origin, entry_of, found_in
    from delta_calibration.history.store import folder_hash

    digest = folder_hash(path)
    if store.require_new(machine, robot.machine_hash, digest, path, name):
        store.moved(machine, digest, path)
        click.echo(f"{machine}: a session that was elsewhere is now at {path}")
        return
    recorded = read_session(path, Topics.from_options(topics))
    warn_of_mistakes(recorded, robot, given, False, True)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    origin = Origin(machine, name, path, digest, topics)
    diagnose = None if quick else lambda seen, robot: diagnosed(seen, robot, None, seed, None)
    entry = entry_of(origin, seen, robot, seed, diagnose)
    store.add(entry, given, robot.machine_hash)
    click.echo(f"added: {name} of {entry.began:%Y-%m-%d %H:%M}; {found_in(entry.verdict)}")


@command.command("list")
@click.option("--machine", default=None, metavar="NAME", help="Which machine; all if not given.")
@STORE
def list_(machine: str | None, url: str) -> None:
    """List machines, or the sessions of one."""
    from delta_calibration.history.entries import found_in, held_out

    with opened(url) as store:
        if machine is None:
            rows = [(name, robot, str(len(store.sessions(name)))) for name, robot in _all(store)]
            click.echo(table(("machine", "robot", "sessions"), rows))
            return
        entries = store.sessions(machine)
    lines = [
        (e.id, f"{e.began:%Y-%m-%d %H:%M}", mm(held_out(e)), found_in(e.verdict)) for e in entries
    ]
    click.echo(table(("session", "began", "held-out error [mm]", "found"), lines))


@command.command("show")
@click.argument("name", metavar="ID")
@_MACHINE
@STORE
@click.option("--verdict", "verdict_file", type=FILE, default=None, help="Write its verdict.")
def show(name: str, machine: str, url: str, verdict_file: Path | None) -> None:
    """Show one session: where it is, what was found, whether the bag is still the same."""
    from delta_calibration.history.entries import found_in, held_out

    with opened(url) as store:
        entries = {entry.id: entry for entry in store.sessions(machine)}
    if name not in entries:
        raise InputError(
            f"{url}: machine {machine!r} has no session {name!r}; it has: {', '.join(entries)}"
        )
    entry = entries[name]
    click.echo(
        f"{machine}, session {name!r} of {entry.began:%Y-%m-%d %H:%M}\n"
        f"path: {entry.path}\nsha256: {entry.sha256}\nadded: {entry.added:%Y-%m-%d %H:%M}\n"
        f"held-out error: {mm(held_out(entry))} mm; {found_in(entry.verdict)}"
    )
    if verdict_file is not None:
        if entry.verdict is None:
            raise InputError(f"session {name!r} was added with --quick: it has no verdict")
        write_text(verdict_file, json.dumps(entry.verdict, indent=2, allow_nan=False) + "\n")
        click.echo(f"written: {verdict_file}")
    entry.require_unchanged()


@command.command("changes")
@_MACHINE
@STORE
@click.option(
    "--json",
    "json_file",
    default=None,
    is_flag=False,
    flag_value="-",
    metavar="[FILE]",
    help="As JSON, to a file or, where none is named, to the standard output alone.",
)
def changes(machine: str, url: str, json_file: str | None) -> None:
    """Tell what changed of the machine, between which sessions, and from what to what.

    All its sessions are fitted together; where the tracker stood and how the reflector was mounted
    is each session's own, and never a change.
    """
    if json_file not in (None, "-"):
        require_folder(Path(str(json_file)))
    found = _changes(machine, url)
    text = json.dumps([c.as_dict() for c in found.changes], indent=2, allow_nan=False) + "\n"
    if json_file == "-":
        click.echo(text, nl=False)
        return
    click.echo(plain("\n".join(found.sentences())))
    if json_file is not None:
        write_text(Path(json_file), text)
        click.echo(f"written: {json_file}")


@command.command("report")
@_MACHINE
@STORE
@click.option("--out", type=FILE, required=True, help="HTML page to write; it opens offline.")
def report(machine: str, url: str, out: Path) -> None:
    """Write the change log of a machine as one HTML page."""
    require_folder(out)
    require_libraries()
    with opened(url) as store:
        from delta_calibration.history.entries import held_out

        errors = [(e.id, e.began, held_out(e)) for e in store.sessions(machine)]
    found = _changes(machine, url)
    write_page(out, page_of_history(machine, found, errors))
    click.echo(plain("\n".join((*found.sentences(), f"written: {out}"))))


def opened(url: str, make: bool = False) -> AbstractContextManager[Store]:
    """A store by its file or URL.

    Raises:
        InputError: SQLAlchemy is not there, or the store cannot be opened.
    """
    try:
        from delta_calibration.history.store import open_store
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "sqlalchemy":
            raise
        raise InputError(
            "a history needs SQLAlchemy: pip install 'delta_calibration[history]'"
        ) from error
    return open_store(url, make)


def _all(store: Store) -> Iterable[tuple[str, str]]:
    return store.machines()


def _changes(machine: str, url: str) -> History:
    """What changed, from the bags of the history."""
    with opened(url) as store:
        entries = store.sessions(machine)
        given, digest = store.robot_of(machine)
    robot = load_robot(given)
    if robot.machine_hash != digest:
        raise InputError(
            f"{url}: machine {machine!r} was added with robot {given!r} of hash {digest[:12]}; "
            f"that file now has hash {robot.machine_hash[:12]}: put the old one back, or begin "
            "another history"
        )
    days = [_read(entry, robot) for entry in progress(entries, len(entries), "session")]
    return find_changes(days, robot, named=robot.named)


def _read(entry: Entry, robot: Robot) -> Dated:
    from delta_calibration.history.entries import dated

    entry.require_unchanged()
    return dated(entry, robot, entry.path)
