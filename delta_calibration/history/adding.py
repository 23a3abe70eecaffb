"""Make history entries: a session with its calibration and its verdict."""

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
    """Make the history entry of a session.

    Args:
        machine: name of the machine.
        name: id of the session.
        path: path or URL of its bag.
        digest: SHA-256 of the bag.
        poses: measured poses; they give the start time.
        calibration: content of the calibration file that was made from the session.
        verdict: content of the verdict file; None without a diagnosis.
        topics: topics with non-standard names, as STREAM=TOPIC.
        by: program that adds the session.
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
    """Read the content of a calibration file.

    Raises:
        ConfigError: it is not a calibration file.
    """
    return read_document(path, lambda _: load_schema("calibration"))


Diagnose = Callable[[Survey, Robot], Diagnosis]


def made_of(
    seen: Survey, robot: Robot, seed: int, diagnose: Diagnose | None
) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Make the calibration and the verdict of a session, as documents.

    Args:
        seen: measured session.
        robot: robot that was measured.
        seed: seed of the random numbers of the fit.
        diagnose: function that finds causes; if None, only the geometry is fitted and there is no
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
    """Fit a session with earlier sessions as prior; the prior and the calibration document.

    The session may have too few places for a diagnosis.

    Args:
        old: other sessions of the machine; only those that began before the new one are used.
        new: session to be fitted.
        robot: robot that was measured.
        seed: seed of the random numbers of the fit.

    Raises:
        DataError: no session began before it, or it has too few places even for such a fit.
    """
    expected = prospect(old, robot, new)
    poses = new.survey.poses
    found = identify(poses, robot, seed=seed, carried=expected.carried)
    return expected, document_of(found, robot, poses)


def newly(name: str, seen: Survey) -> Dated:
    """Give a session that is not in the history yet its name and start time."""
    began = datetime.fromtimestamp(seen.poses.start_ns * 1e-9, timezone.utc)
    return Dated(name, began, seen)


def read_again(entry: Entry, robot: Robot) -> Dated:
    """Read the session of an entry again from its bag.

    Raises:
        InputError: the bag is missing or was changed.
    """
    entry.require_unchanged()
    with at_hand(entry.path) as folder:
        return dated(entry, robot, folder)


def dated(entry: Entry, robot: Robot, folder: Path) -> Dated:
    """Read the session of an entry from a folder, with the effects that its diagnosis found.

    An update gets no effects: those in its calibration were found in other sessions.
    """
    recorded = read_session(folder, Topics.from_options(entry.topics))
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    if entry.is_update:
        return Dated(entry.id, entry.began, seen)
    calibration = calibration_of(entry.calibration, robot, f"history: {entry.id}")
    return Dated(entry.id, entry.began, seen, calibration.chain.effects)
