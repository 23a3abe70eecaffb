"""`delta-cal history`: keep the sessions of a machine, and report changes between them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from delta_calibration.cli.adding import Found, found_of, known_of, update_of
from delta_calibration.cli.check import warn_of_mistakes
from delta_calibration.cli.kept import Reread, robot_kept, store_option
from delta_calibration.cli.options import (
    require_folder,
    robot_option,
    seed_option,
    table,
    topics_option,
    write_text,
)
from delta_calibration.cli.verb import OUTPUT, OUTPUT_OR_PRINTED, VerbGroup
from delta_calibration.data import Survey, survey
from delta_calibration.errors import InputError
from delta_calibration.history import History, find_changes
from delta_calibration.history.opening import opened
from delta_calibration.recording import Topics, read_session
from delta_calibration.report import require_libraries, write_page
from delta_calibration.report.history import page_of_history
from delta_calibration.robot import Robot, load_robot
from delta_calibration.wording import mm, plain

if TYPE_CHECKING:  # other verbs need not load a database's library
    from delta_calibration.history.store import Store

_FILE = click.Path(path_type=Path)
_MACHINE = click.option("--machine", required=True, metavar="NAME", help="Name of the machine.")


@click.group("history", cls=VerbGroup)
def command() -> None:
    """Keep the sessions of a machine together and report what changed between them.

    Needs SQLAlchemy: pip install 'delta_calibration[history]'.
    """


@command.command("add")
@click.argument("sessions", nargs=-1, required=True)
@robot_option
@_MACHINE
@store_option
@click.option(
    "--id",
    "name",
    default=None,
    help="Name of the session, if only one is added.  [default: its folder's name]",
)
@click.option(
    "--quick",
    is_flag=True,
    help="Only fit the geometry; do not look for causes and store no verdict.",
)
@click.option(
    "--update",
    is_flag=True,
    help="Fit with the results of the earlier sessions, as `fit --machine` does, without looking "
    "for causes. Sessions with fewer than 12 places are always fitted like this.",
)
@click.option(
    "--verdict",
    "verdict_file",
    type=_FILE,
    default=None,
    help="Verdict of a single session, written by `diagnose --json`; it is not diagnosed again.",
)
@click.option(
    "--calibration",
    "calibration_file",
    type=_FILE,
    default=None,
    help="Extended calibration written by `diagnose --out`, with --verdict.",
)
@seed_option
@topics_option
def add(
    sessions: tuple[str, ...],
    robot_file: str,
    machine: str,
    url: str,
    name: str | None,
    quick: bool,
    update: bool,
    verdict_file: Path | None,
    calibration_file: Path | None,
    seed: int,
    topics: tuple[str, ...],
) -> None:
    """Diagnose SESSIONS and add them, with calibration and verdict, to the history of a machine.

    The bags stay where they are; the history stores their paths and hashes. A session may be a
    URL as fsspec takes it, such as s3://bucket/day_1 or zip://day_1::days.zip. After an error, the
    sessions added before it remain in the history.

    The first session of a machine needs 12 places or more. A later one may have as few as 5, as
    `plan --update` chooses them: it is fitted with what the sessions before it say.
    """
    from delta_calibration.history import bags

    robot = load_robot(robot_file)
    if name is not None and len(sessions) > 1:
        raise InputError(f"--id {name}: names a single session, but {len(sessions)} are given")
    for session in sessions:
        if not bags.is_there(session):
            raise InputError(f"{session}: not the folder of a session")
    known = known_of(sessions, verdict_file, calibration_file, quick, update)
    given = str(Path(robot_file).resolve()) if Path(robot_file).is_file() else robot_file
    reread = Reread()
    with opened(url, make=True) as store:
        for session in sessions:
            path, own = bags.place_of(session), name or bags.name_of(session)
            alone = partial(found_of, known=known, robot=robot, seed=seed, quick=quick)
            told = partial(
                update_of, name=own, store=store, machine=machine, seed=seed, reread=reread
            )
            make = partial(_made, alone=alone, told=told, known=known is not None, update=update)
            _add(store, machine, path, own, robot, given, topics, make)
        count = len(store.sessions(machine))
    click.echo(f"{store.name}: {machine} has {count} session{'' if count == 1 else 's'}")


def _made(
    seen: Survey,
    alone: Callable[[Survey], Found],
    told: Callable[[Survey], Found],
    known: bool,
    update: bool,
) -> Found:
    """Calibration and verdict of a session: alone, or with the history if it has few places."""
    from delta_calibration.history.few import is_few

    return told(seen) if update or (is_few(seen) and not known) else alone(seen)


def _add(
    store: Store,
    machine: str,
    path: str,
    name: str,
    robot: Robot,
    given: str,
    topics: tuple[str, ...],
    make: Callable[[Survey], Found],
) -> None:
    """Add one session, or store the new path of one that the history has already."""
    from delta_calibration.history.adding import entry_of
    from delta_calibration.history.bags import at_hand, bag_hash

    digest = bag_hash(path)
    if store.require_new(machine, robot.machine_hash, digest, path, name):
        store.moved(machine, digest, path)
        click.echo(f"{machine}: a session of the history was moved; it is now at {path}")
        return
    with at_hand(path) as folder:
        recorded = read_session(folder, Topics.from_options(topics))
    warn_of_mistakes(recorded, robot, given, force=False, out=True, can_force=False)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    entry = entry_of(machine, name, path, digest, seen.poses, *make(seen), topics)
    store.add(entry, given, robot.machine_hash)
    click.echo(f"added: {name} of {entry.began:%Y-%m-%d %H:%M}; {entry.found}")


@command.command("list")
@click.option(
    "--machine",
    default=None,
    metavar="NAME",
    help="Name of the machine; all machines if not given.",
)
@store_option
def list_(machine: str | None, url: str) -> None:
    """List machines, or the sessions of one."""
    with opened(url) as store:
        if machine is None:
            rows = [(name, robot, str(len(store.sessions(name)))) for name, robot in _all(store)]
            click.echo(table(("machine", "robot", "sessions"), rows))
            return
        entries = store.sessions(machine)
    lines = [(e.id, f"{e.began:%Y-%m-%d %H:%M}", mm(e.error_left_mm), e.named) for e in entries]
    click.echo(table(("session", "began", "error left [mm]", "found"), lines))


@command.command("show")
@click.argument("name", metavar="ID")
@_MACHINE
@store_option
@click.option(
    "--verdict",
    "verdict_file",
    type=OUTPUT,
    default=None,
    help="JSON file to write its verdict to.",
)
def show(name: str, machine: str, url: str, verdict_file: Path | None) -> None:
    """Show one session: where it is, what was found, whether the bag is still the same.

    ID is the session's name, as `history list --machine NAME` shows it.
    """
    with opened(url) as store:
        entries = {entry.id: entry for entry in store.sessions(machine)}
    if name not in entries:
        raise InputError(
            f"{store.name}: machine {machine!r} has no session {name!r}; it has: "
            f"{', '.join(entries)}"
        )
    entry = entries[name]
    click.echo(
        f"{machine}, session {name!r} of {entry.began:%Y-%m-%d %H:%M}\n"
        f"path: {entry.path}\nsha256: {entry.sha256}\n"
        f"added: {entry.added:%Y-%m-%d %H:%M} by {entry.added_by}\n"
        f"error left: {mm(entry.error_left_mm)} mm; {entry.found}"
    )
    if verdict_file is not None:
        if entry.verdict is None:
            raise InputError(f"session {name!r} was added with --quick: it has no verdict")
        write_text(verdict_file, json.dumps(entry.verdict, indent=2, allow_nan=False) + "\n")
        click.echo(f"written: {verdict_file}")
    entry.require_unchanged()


@command.command("changes")
@_MACHINE
@store_option
@click.option(
    "--json",
    "json_file",
    type=OUTPUT_OR_PRINTED,
    default=None,
    is_flag=False,
    flag_value="-",
    metavar="[FILE]",
    help="Write JSON to FILE, or print only JSON if no file is given.",
)
def changes(machine: str, url: str, json_file: str | None) -> None:
    """Report what changed on the machine, between which sessions, and from what value to what.

    All sessions are fitted together. The tracker's place and the reflector's mounting belong to
    each session; they are never reported as a change.
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
@store_option
@click.option("--out", type=OUTPUT, required=True, help="HTML page to write; it opens offline.")
def report(machine: str, url: str, out: Path) -> None:
    """Write the change log of a machine as one HTML page."""
    require_folder(out)
    require_libraries()
    with opened(url) as store:
        errors = [(e.id, e.began, e.error_left_mm) for e in store.sessions(machine)]
    found = _changes(machine, url)
    write_page(out, page_of_history(machine, found, errors))
    click.echo(plain("\n".join((*found.sentences(), f"written: {out}"))))


def _all(store: Store) -> Iterable[tuple[str, str]]:
    return store.machines()


def _changes(machine: str, url: str) -> History:
    """Changes of a machine, found by reading its bags again; kept for the page of a fleet."""
    from delta_calibration.history.ledger import Ledger, compared_of

    with opened(url) as store:
        robot = robot_kept(store, machine)
        entries = store.sessions(machine)
        found = find_changes(Reread()(entries, robot), robot, named=robot.named)
        with suppress(
            InputError
        ):  # a store that cannot be written to has a change log all the same
            Ledger(store).keep_compared(compared_of(machine, entries, found.changes))
    return found
