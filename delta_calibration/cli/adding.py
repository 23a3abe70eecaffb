"""Calibration and verdict of a session to be added to a history: computed, or read from files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.diagnose import diagnosed
from delta_calibration.cli.fit import describe_carried
from delta_calibration.cli.kept import Reread, robot_kept
from delta_calibration.data import Survey
from delta_calibration.diagnosis import FEWEST, Diagnosis
from delta_calibration.errors import DataError, InputError
from delta_calibration.report import read_verdict
from delta_calibration.robot import Robot
from delta_calibration.texts import read_text

if TYPE_CHECKING:  # other verbs do not wait for a database's library
    from delta_calibration.history.store import Store

Found = tuple[dict[str, Any], dict[str, Any] | None]  # a calibration's document, a verdict


def known_of(
    sessions: tuple[str, ...],
    verdict: Path | None,
    calibration: Path | None,
    quick: bool,
    update: bool,
) -> tuple[Path, Path] | None:
    """Files of an existing verdict and calibration; None if they are to be computed.

    Raises:
        InputError: one without the other, several sessions, or --quick or --update beside them.
    """
    if verdict is None and calibration is None:
        return None
    if verdict is None or calibration is None:
        raise InputError(
            "--verdict and --calibration must be given together; both are files of one diagnosis"
        )
    if len(sessions) > 1:
        raise InputError(
            f"--verdict {verdict}: belongs to one session, but {len(sessions)} are given"
        )
    if quick:
        raise InputError("--quick: stores no verdict, but --verdict gives one")
    if update:
        raise InputError("--update: fits with the history, but --calibration gives another fit")
    return verdict, calibration


def found_of(
    seen: Survey, known: tuple[Path, Path] | None, robot: Robot, seed: int, quick: bool
) -> Found:
    """Calibration and verdict of a session: read from the files `known`, else computed."""
    if known is not None:
        return _read_found(seen, robot, *known)
    from delta_calibration.history.adding import made_of

    def diagnose(seen: Survey, robot: Robot) -> Diagnosis:
        return diagnosed(seen, robot, None, seed, None)

    return made_of(seen, robot, seed, None if quick else diagnose)


def update_of(
    seen: Survey, name: str, store: Store, machine: str, seed: int, reread: Reread
) -> Found:
    """Calibration of a session with few places, fitted with priors from the history; no verdict.

    Raises:
        DataError: the machine has no earlier session, or this one has too few places.
    """
    from delta_calibration.history.adding import newly, updated
    from delta_calibration.history.few import places_of

    if machine not in dict(store.machines()):
        raise DataError(
            f"{seen.poses.source}: the first session of a machine needs at least {FEWEST} "
            f"different poses at rest, but this one has {places_of(seen)}; {store.name} has no "
            "machine "
            f"{machine!r}"
        )
    robot = robot_kept(store, machine)
    old = reread(store.sessions(machine), robot)
    expected, calibration = updated(old, newly(name, seen), robot, seed)
    click.echo(describe_carried(expected, name))
    return calibration, None


def _read_found(seen: Survey, robot: Robot, verdict_file: Path, calibration_file: Path) -> Found:
    """Read the calibration and the verdict that a diagnosis of this very session wrote.

    Raises:
        InputError: a file of another kind, session or robot.
    """
    from delta_calibration.history.adding import calibration_document

    load_calibration(calibration_file, robot)
    calibration = calibration_document(calibration_file)
    if calibration["provenance"]["measured_sha256"] != seen.poses.digest:
        raise InputError(
            f"{calibration_file}: was made from other poses than those of {seen.poses.source}"
        )
    if "prior" in calibration["provenance"]:
        raise InputError(
            f"{calibration_file}: was fitted with the results of other sessions; give the one "
            "that `diagnose --out` wrote from this session alone"
        )
    verdict = read_verdict(verdict_file).verdict
    if verdict.session.poses != len(seen.poses):
        raise InputError(
            f"{verdict_file}: is of {verdict.session.poses} poses; {seen.poses.source} has "
            f"{len(seen.poses)}: it is the verdict of another session"
        )
    return calibration, json.loads(read_text(verdict_file))
