"""Access of verbs to a history: its store, a machine's robot, and its sessions read again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from delta_calibration.cli.options import Function, progress
from delta_calibration.errors import InputError
from delta_calibration.robot import Robot, load_robot

if TYPE_CHECKING:  # other verbs need not load a history's libraries
    from delta_calibration.history import Dated
    from delta_calibration.history.store import Entry, Store

STORE = "history.sqlite"


def store_option(function: Function) -> Function:
    """`--store`: file or database of a history."""
    return click.option(
        "--store",
        "url",
        default=STORE,
        show_default=True,
        metavar="FILE|URL",
        help="The history: an SQLite file, or the URL of a database (SQLAlchemy).",
    )(function)


def known_machine_option(what: str) -> Callable[[Function], Function]:
    """`--machine` of a verb that also works without a history.

    Args:
        what: end of the help text, which says what the history is used for.
    """
    return click.option(
        "--machine",
        default=None,
        metavar="NAME",
        help=f"Machine of a history (--store): {what}",
    )


def robot_kept(store: Store, machine: str) -> Robot:
    """The robot of a machine, by the file that it was added with.

    Raises:
        InputError: no such machine, or the robot in the file has changed.
    """
    given, digest = store.robot_of(machine)
    robot = load_robot(given)
    if robot.machine_hash != digest:
        raise InputError(
            f"{store.name}: machine {machine!r} was added with robot {given!r} of hash "
            f"{digest[:12]}; that file now has hash {robot.machine_hash[:12]}: put the old one "
            "back, or begin another history"
        )
    return robot


def robot_given(robot_file: str | None, machine: str | None, url: str) -> Robot:
    """The robot of `--robot`, or that of a machine of the history.

    Raises:
        InputError: neither is given, a store without a machine, or the file is of another robot
            than the machine.
    """
    if machine is None:
        if url != STORE:
            raise InputError(f"--store {url}: give --machine as well, a machine of this history")
        if robot_file is None:
            raise InputError("give --robot, or --machine of a history")
        return load_robot(robot_file)
    from delta_calibration.history.opening import opened

    with opened(url) as store:
        kept = robot_kept(store, machine)
    if robot_file is None:
        return kept
    robot = load_robot(robot_file)
    if robot.machine_hash != kept.machine_hash:
        raise InputError(
            f"--robot {robot_file} has hash {robot.machine_hash[:12]}; machine {machine!r} of "
            f"{store.name} is of {kept.source} with hash {kept.machine_hash[:12]}"
        )
    return robot


def sessions_of(machine: str, robot: Robot, url: str) -> list[Dated]:
    """Read the sessions of a machine again."""
    from delta_calibration.history.opening import opened

    with opened(url) as store:
        entries = store.sessions(machine)
    return Reread()(entries, robot)


class Reread:
    """Reads sessions of a machine again, each only once, because a bag may be remote."""

    def __init__(self) -> None:
        """Start with no session read."""
        self._read: dict[str, Dated] = {}

    def __call__(self, entries: Sequence[Entry], robot: Robot) -> list[Dated]:
        """Sessions of the entries, each with the effects in its calibration."""
        from delta_calibration.history import adding

        new = [entry for entry in entries if entry.sha256 not in self._read]
        for entry in progress(new, len(new), "session"):
            self._read[entry.sha256] = adding.read_again(entry, robot)
        return [self._read[entry.sha256] for entry in entries]
