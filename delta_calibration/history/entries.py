"""A session on its way into the history, and out of it again: fitted, diagnosed, and read anew."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from delta_calibration.calibration_file import load_calibration, save_calibration, save_extended
from delta_calibration.data import Survey, survey
from delta_calibration.diagnosis import Diagnosis
from delta_calibration.documents import load_schema, read_document
from delta_calibration.estimation import identify
from delta_calibration.history.pooled import Dated
from delta_calibration.history.store import Entry
from delta_calibration.recording import Topics, read_session
from delta_calibration.robot import Robot

Diagnose = Callable[[Survey, Robot], Diagnosis]


@dataclass(frozen=True)
class Origin:
    """Where a session comes from, and under which name the history keeps it."""

    machine: str
    id: str
    path: Path
    sha256: str
    topics: tuple[str, ...] = ()  # of another name, as STREAM=TOPIC


def entry_of(
    origin: Origin, seen: Survey, robot: Robot, seed: int, diagnose: Diagnose | None
) -> Entry:
    """The session with what a fit or a diagnosis makes of it.

    Args:
        origin: where it comes from.
        seen: what was measured.
        robot: what was measured.
        seed: of what a fit leaves to chance.
        diagnose: finds causes; where it is not given, the geometry is fitted only, and there is no
            verdict.
    """
    verdict = None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "calibration.yaml"
        if diagnose is None:
            save_calibration(file, identify(seen.poses, robot, seed=seed), robot, seen.poses)
        else:
            found = diagnose(seen, robot)
            save_extended(file, found, robot, seen.poses)
            verdict = found.verdict.as_dict()
        calibration = read_document(file, lambda _: load_schema("calibration"))
    return Entry(
        machine=origin.machine,
        id=origin.id,
        path=origin.path,
        sha256=origin.sha256,
        began=datetime.fromtimestamp(seen.poses.start_ns * 1e-9, timezone.utc),
        added=datetime.now(timezone.utc),
        topics=origin.topics,
        calibration=json.loads(json.dumps(calibration, default=str)),
        verdict=verdict,
    )


def dated(entry: Entry, robot: Robot, folder: Path) -> Dated:
    """The session of an entry, read again from a folder, with the effects of its calibration."""
    recorded = read_session(folder, Topics.from_options(entry.topics))
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    with tempfile.TemporaryDirectory() as own:
        file = Path(own) / "calibration.json"
        file.write_text(json.dumps(entry.calibration), encoding="utf-8")
        calibration = load_calibration(file, robot)
    return Dated(entry.id, entry.began, seen, calibration.chain.effects)


def found_in(verdict: dict[str, Any] | None) -> str:
    """What a verdict found, in a few words."""
    if verdict is None:
        return "no causes looked for"
    named = [
        f["cause"] + (f" at {f['location']}" if f["location"] else "") for f in verdict["findings"]
    ]
    return f"found: {', '.join(named) or 'nothing beyond geometry'}"


def held_out(entry: Entry) -> float:
    """Error left of the model of a session [mm]."""
    if entry.verdict is not None:
        return float(entry.verdict["extended"]["held_out_rms_mm"])
    return float(entry.calibration["residuals"]["full"]["error_left_rms_mm"])
