"""Provenance of a report: hashes, versions and seeds."""

from __future__ import annotations

import hashlib
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

from delta_calibration import __version__
from delta_calibration.calibration import Calibration
from delta_calibration.data import Poses
from delta_calibration.errors import RecordingError
from delta_calibration.report.document import Table
from delta_calibration.robot import Robot
from delta_calibration.wording import moment

_LIBRARIES = ("numpy", "scipy", "plotly", "mcap", "rosbags")
_PIECE = 1 << 20  # [byte]


@dataclass(frozen=True)
class Provenance:
    """Sources of a report."""

    session: str
    session_sha256: str
    start_ns: int
    robot: str
    robot_source: str
    robot_sha256: str
    seed: int
    calibration: str = ""
    calibration_sha256: str = ""
    cycles: str = ""  # session of the cycles of ISO 9283, if it is another one
    cycles_sha256: str = ""
    recorded: Mapping[str, str] = field(default_factory=dict)  # metadata of the session
    notes: tuple[str, ...] = ()
    made_ns: int | None = None  # Unix time of the report [ns]
    seeded: str = "diagnosis"  # what the seed was used for; empty: for nothing

    def table(self) -> Table:
        """Table of the provenance."""
        rows = [
            ("session", self.session),
            ("recorded", moment(self.start_ns)),
            ("session, SHA-256", self.session_sha256),
            ("robot", f"{self.robot} ({self.robot_source})"),
            ("robot, SHA-256", self.robot_sha256),
            *([(f"seed of the {self.seeded}", str(self.seed))] if self.seeded else ()),
            ("delta_calibration", __version__),
            ("Python", platform.python_version()),
            *((name, version(name)) for name in _LIBRARIES),
            *((f"session: {key}", value) for key, value in sorted(self.recorded.items())),
            *(("note", note) for note in self.notes),
        ]
        if self.made_ns is not None:
            rows.append(("report made", moment(self.made_ns)))
        if self.calibration:
            rows += [
                ("calibration in force", self.calibration),
                ("its SHA-256", self.calibration_sha256),
            ]
        if self.cycles:
            rows += [
                ("session of ISO 9283", self.cycles),
                ("its SHA-256", self.cycles_sha256),
            ]
        return Table("provenance", "", ("", ""), tuple(rows), words=(0, 1))


def session_provenance(
    session: Path,
    poses: Poses,
    robot: Robot,
    seed: int,
    recorded: Mapping[str, str],
    calibration: Calibration | None = None,
    seeded: str = "diagnosis",
) -> Provenance:
    """Make the provenance of a recorded session.

    Args:
        session: its folder or file.
        poses: measured in it.
        robot: drawing of the machine.
        seed: of random numbers.
        recorded: metadata of the session.
        calibration: that the session is held against.
        seeded: what the seed was used for; empty if for nothing.

    Raises:
        RecordingError: a file of the session cannot be read.
    """
    return Provenance(
        session=Path(poses.source).name or poses.source,
        session_sha256=hash_of(session),
        start_ns=poses.start_ns,
        robot=robot.name,
        robot_source=Path(robot.source).name,
        robot_sha256=robot.hash,
        seed=seed,
        calibration="" if calibration is None else Path(calibration.source).name,
        calibration_sha256="" if calibration is None else calibration.seal,
        recorded=dict(recorded),
        notes=poses.notes,
        made_ns=time.time_ns(),
        seeded=seeded,
    )


def hash_of(path: Path) -> str:
    """SHA-256 of the name and content of a file, or of a folder's storage files in name order.

    Raises:
        RecordingError: a file cannot be read.
    """
    digest = hashlib.sha256()
    files = [path] if path.is_file() else sorted(f for f in path.glob("*") if _stored(f))
    try:
        for file in files:
            digest.update(file.name.encode())
            with file.open("rb") as stream:
                while piece := stream.read(_PIECE):
                    digest.update(piece)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()


def _stored(file: Path) -> bool:
    return file.is_file() and file.suffix in (".mcap", ".db3", ".zstd", ".yaml")


def version(name: str) -> str:
    """Version of an installed library."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"
