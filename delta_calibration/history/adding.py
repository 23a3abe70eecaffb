"""A session with what was made of it, as the history of a machine keeps it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from delta_calibration.calibration_file import calibration_of, document_of
from delta_calibration.data import Poses, Survey, survey
from delta_calibration.diagnosis import Diagnosis
from delta_calibration.documents import load_schema, read_document
from delta_calibration.estimation import identify
from delta_calibration.history.bags import at_hand
from delta_calibration.history.continual import Prospect, prospect
from delta_calibration.history.pooled import Dated
from delta_calibration.history.store import BY_COMMAND, Entry
from delta_calibration.recording import Topics, read_session
from delta_calibration.robot import Robot


def entry_of(
    machine: str,
    name: str,
    path: str,
    digest: str,
    poses: Poses,
    calibration: dict[str, Any],
    verdict: dict[str, Any] | None,
    topics: Sequence[str] = (),
    by: str = BY_COMMAND,
) -> Entry:
    """What is to be kept of a session.

    Args:
        machine: its name.
        name: id of the session.
        path: of its bag.
        digest: SHA-256 of the bag.
        poses: that were measured.
        calibration: that was made of it, the document of its file.
        verdict: of a diagnosis, as its file holds it; None where there was none.
        topics: of other names, as STREAM=TOPIC.
        by: which program adds it.
    """
    return Entry(
        machine=machine,
        id=name,
        path=path,
        sha256=digest,
        began=datetime.fromtimestamp(poses.start_ns * 1e-9, timezone.utc),
        added=datetime.now(timezone.utc),
        topics=tuple(topics),
        calibration=json.loads(json.dumps(calibration, default=str)),
        verdict=verdict,
        added_by=by,
    )


def calibration_document(path: Path) -> dict[str, Any]:
    """The document of a calibration file.

    Raises:
        ConfigError: it is none.
    """
    return read_document(path, lambda _: load_schema("calibration"))


Diagnose = Callable[[Survey, Robot], Diagnosis]


def made_of(
    seen: Survey, robot: Robot, seed: int, diagnose: Diagnose | None
) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Calibration and verdict of a session, as documents.

    Args:
        seen: what was measured.
        robot: what was measured.
        seed: of what a fit leaves to chance.
        diagnose: finds causes; where it is not given, the geometry is fitted only, and there is no
            verdict.
    """
    if diagnose is None:
        fitted = identify(seen.poses, robot, seed=seed)
        return document_of(fitted, robot, seen.poses), None
    found = diagnose(seen, robot)
    calibration = document_of(found.identification, robot, seen.poses)
    return calibration, found.verdict.as_dict()


def updated(
    old: Sequence[Dated], new: Dated, robot: Robot, seed: int
) -> tuple[Prospect, dict[str, Any]]:
    """Calibration of a session that is fitted with what those before it say, as a document.

    It may have few places, of which no diagnosis can be made.

    Args:
        old: other sessions of the machine; those that began before the new one count.
        new: the session.
        robot: what was measured.
        seed: of what a fit leaves to chance.

    Raises:
        DataError: no session began before, or the new one has hardly any places.
    """
    expected = prospect(old, robot, new)
    poses = new.survey.poses
    found = identify(poses, robot, seed=seed, carried=expected.carried)
    return expected, document_of(found, robot, poses)


def newly(name: str, seen: Survey) -> Dated:
    """A session that is not in the history yet."""
    began = datetime.fromtimestamp(seen.poses.start_ns * 1e-9, timezone.utc)
    return Dated(name, began, seen)


def read_again(entry: Entry, robot: Robot) -> Dated:
    """The session of an entry, from its bag.

    Raises:
        InputError: the bag is gone or was changed.
    """
    entry.require_unchanged()
    with at_hand(entry.path) as folder:
        return dated(entry, robot, folder)


def dated(entry: Entry, robot: Robot, folder: Path) -> Dated:
    """The session of an entry, read again from a folder, with the effects that it showed.

    What an update has in its calibration was found in other sessions.
    """
    recorded = read_session(folder, Topics.from_options(entry.topics))
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    if entry.is_update:
        return Dated(entry.id, entry.began, seen)
    calibration = calibration_of(entry.calibration, robot, f"history: {entry.id}")
    return Dated(entry.id, entry.began, seen, calibration.chain.effects)
