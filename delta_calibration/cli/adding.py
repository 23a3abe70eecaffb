"""A session on its way into a history: what a fit or a diagnosis makes of it, or has made."""

from __future__ import annotations

import json
import tempfile
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta_calibration.calibration_file import load_calibration, save_calibration, save_extended
from delta_calibration.cli.diagnose import diagnosed
from delta_calibration.data import Survey
from delta_calibration.documents import load_schema, read_document
from delta_calibration.errors import InputError
from delta_calibration.estimation import identify
from delta_calibration.report import read_verdict
from delta_calibration.robot import Robot
from delta_calibration.texts import read_text

if TYPE_CHECKING:  # other verbs do not wait for a database's library
    from delta_calibration.history.store import Entry

Found = tuple[dict[str, Any], dict[str, Any] | None]  # a calibration's document, a verdict


def known_of(
    sessions: tuple[Path, ...], verdict: Path | None, calibration: Path | None, quick: bool
) -> tuple[Path, Path] | None:
    """Verdict and calibration that were made already; None where they are to be made.

    Raises:
        InputError: one without the other, of several sessions, or with --quick.
    """
    if verdict is None and calibration is None:
        return None
    if verdict is None or calibration is None:
        raise InputError("--verdict and --calibration go together, as one diagnosis wrote them")
    if len(sessions) > 1:
        raise InputError(f"--verdict {verdict}: of a single session; {len(sessions)} are given")
    if quick:
        raise InputError("--quick: makes no verdict, and --verdict gives one")
    return verdict, calibration


def entry_of(
    machine: str,
    name: str,
    path: Path,
    digest: str,
    topics: tuple[str, ...],
    seen: Survey,
    found: Found,
) -> Entry:
    """The session with what a fit or a diagnosis makes of it."""
    from delta_calibration.history.store import Entry

    calibration, verdict = found
    return Entry(
        machine=machine,
        id=name,
        path=path,
        sha256=digest,
        began=datetime.fromtimestamp(seen.poses.start_ns * 1e-9, timezone.utc),
        added=datetime.now(timezone.utc),
        topics=topics,
        calibration=json.loads(json.dumps(calibration, default=str)),
        verdict=verdict,
    )


def found_of(
    seen: Survey, known: tuple[Path, Path] | None, robot: Robot, seed: int, quick: bool
) -> Found:
    """Calibration and verdict of a session: read where they are known, else made."""
    if known is not None:
        return _read_found(seen, robot, *known)
    verdict = None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "calibration.yaml"
        if quick:
            save_calibration(file, identify(seen.poses, robot, seed=seed), robot, seen.poses)
        else:
            found = diagnosed(seen, robot, None, seed, None)
            save_extended(file, found, robot, seen.poses)
            verdict = found.verdict.as_dict()
        return _calibration_document(file), verdict


def _read_found(seen: Survey, robot: Robot, verdict_file: Path, calibration_file: Path) -> Found:
    """What a diagnosis of this very session wrote.

    Raises:
        InputError: a file that is none of these, or of another session or robot.
    """
    load_calibration(calibration_file, robot)
    calibration = _calibration_document(calibration_file)
    if calibration["provenance"]["measured_sha256"] != seen.poses.digest:
        raise InputError(
            f"{calibration_file}: was made from other poses than those of {seen.poses.source}"
        )
    verdict = read_verdict(verdict_file).verdict
    if verdict.session.poses != len(seen.poses):
        raise InputError(
            f"{verdict_file}: is of {verdict.session.poses} poses; {seen.poses.source} has "
            f"{len(seen.poses)}: a verdict of another session"
        )
    return calibration, json.loads(read_text(verdict_file))


def _calibration_document(path: Path) -> dict[str, Any]:
    return read_document(path, lambda _: load_schema("calibration"))
