"""Work of the cluster's workers: process one session, or compare a machine's sessions.

All functions depend on their arguments only and have no side effects: the work of a lost worker
is simply done again by another one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from delta_calibration.data import Survey, survey
from delta_calibration.diagnosis import Diagnosis, diagnose
from delta_calibration.doctor import check
from delta_calibration.errors import CalibrationError, InputError, MistakeError
from delta_calibration.fleet.places import Place, RobotFile, local
from delta_calibration.history import Dated, find_changes
from delta_calibration.history.adding import dated, entry_of, made_of, newly, updated
from delta_calibration.history.bags import bag_hash
from delta_calibration.history.few import is_few
from delta_calibration.history.ledger import Compared, Failure, compared_of
from delta_calibration.history.store import Entry
from delta_calibration.recording import Topics, read_session
from delta_calibration.robot import Robot, robot_from

_Made = TypeVar("_Made")


@dataclass(frozen=True)
class Job:
    """A session to be checked, fitted and diagnosed."""

    machine: str
    place: Place
    robot: RobotFile
    done: frozenset[str]  # hashes of the machine's sessions that need no more work
    failed: str | None = None  # hash of its content when it failed; not tried again
    quick: bool = False  # fit only
    seed: int = 0


@dataclass(frozen=True)
class There:
    """A session that needed no work."""

    machine: str
    id: str
    failed: bool = False  # whether it failed before and is unchanged since


@dataclass(frozen=True)
class Few:
    """A session with few places, to be fitted when the others of its machine are done."""

    job: Job
    began: datetime


@dataclass(frozen=True)
class Update:
    """A session with few places to be fitted, and the sessions of its machine that are done."""

    job: Job
    entries: tuple[Entry, ...]

    @property
    def machine(self) -> str:
        """Name of its machine."""
        return self.job.machine

    @property
    def place(self) -> Place:
        """Id and folder of the session."""
        return self.job.place


@dataclass(frozen=True)
class Comparison:
    """The sessions of a machine to be compared."""

    machine: str
    robot: RobotFile
    entries: tuple[Entry, ...]
    place: None = None  # not work on a single session


def examine(job: Job) -> Entry | Failure | There | Few:
    """Check, fit and diagnose one session; an error of the session gives a `Failure`."""
    return _examined(job, lambda folder, digest: _entry(job, folder, digest))


def update(work: Update) -> Entry | Failure | There:
    """Fit a session with few places, with the other sessions of its machine as prior."""
    return _examined(work.job, lambda folder, digest: _updated(work, folder, digest))


def _examined(job: Job, work: Callable[[Path, str], _Made]) -> _Made | Failure | There:
    """Do the work on a session, unless it is done or failed before and is unchanged."""
    digest, place = "", job.place
    try:
        with local(place.url) as folder:
            digest = bag_hash(str(folder))
            if digest in job.done or digest == job.failed:
                return There(job.machine, place.id, digest == job.failed)
            try:
                return work(folder, digest)
            except CalibrationError as error:
                told = str(error).replace(str(folder), place.url)
    except CalibrationError as error:
        told = str(error)
    return Failure(job.machine, place.id, digest, told)


def compare(job: Comparison) -> Compared:
    """Find the changes of a machine between its sessions."""
    try:
        robot = robot_from(job.robot.document, job.robot.given)
        found = find_changes(_days(job.entries, robot), robot, named=robot.named)
    except CalibrationError as error:
        return replace(compared_of(job.machine, job.entries, ()), told=str(error))
    return compared_of(job.machine, job.entries, found.changes)


def _days(entries: Sequence[Entry], robot: Robot) -> list[Dated]:
    """Read sessions of the history again from their bags."""
    with ExitStack() as stack:
        folders = [stack.enter_context(local(entry.path)) for entry in entries]
        for entry, folder in zip(entries, folders, strict=True):
            if bag_hash(str(folder)) != entry.sha256:
                raise InputError(f"{entry.path}: was changed since it was added")
        return [dated(e, robot, f) for e, f in zip(entries, folders, strict=True)]


def _entry(job: Job, folder: Path, digest: str) -> Entry | Few:
    robot, seen = _seen(job, folder)
    place = job.place
    if is_few(seen):
        return Few(job, newly(place.id, seen).began)

    def diagnosed(seen: Survey, robot: Robot) -> Diagnosis:
        return diagnose(seen, robot, seed=job.seed)

    made = made_of(seen, robot, job.seed, None if job.quick else diagnosed)
    return entry_of(job.machine, place.id, place.url, digest, seen.poses, *made, place.topics)


def _updated(work: Update, folder: Path, digest: str) -> Entry:
    job, place = work.job, work.job.place
    robot, seen = _seen(job, folder)
    days = _days(work.entries, robot)
    _, calibration = updated(days, newly(place.id, seen), robot, job.seed)
    made = calibration, None
    return entry_of(job.machine, place.id, place.url, digest, seen.poses, *made, place.topics)


def _seen(job: Job, folder: Path) -> tuple[Robot, Survey]:
    """Read the robot and the survey of a session, and refuse a session with recording mistakes.

    Raises:
        MistakeError: the check found mistakes.
    """
    robot = robot_from(job.robot.document, job.robot.given)
    recorded = read_session(folder, Topics.from_options(job.place.topics))
    found = check(recorded, robot, job.robot.document, job.robot.given).found
    if found:
        raise MistakeError("; ".join(mistake.sentence() for mistake in found))
    return robot, survey(recorded, robot.joints.names, robot.commanded.joint_size)
