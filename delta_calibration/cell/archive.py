"""Adds what was captured and fitted to the history of the machine."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from delta_calibration.cell.fitting import FittedCalibration
from delta_calibration.data import Session
from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.history.opening import opened, require_library
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot

_TIME = "%Y%m%d_%H%M%S"


@dataclass(frozen=True)
class Archive:
    """The history of one machine, and the folder that its bags are written to."""

    url: str  # of the store, or its file
    machine: str
    bags: Path
    robot: Robot
    given: str  # the robot's file or name, as the node was given it

    @classmethod
    def of(cls, url: str, machine: str, bags: str, robot: Robot, given: str) -> Archive | None:
        """What the parameters ask for; None where they ask for no history.

        Raises:
            InputError: a history without a machine, or the library for it is missing.
        """
        if not url:
            return None
        if not machine:
            raise InputError("parameter machine: is empty; it names whose history is kept")
        if not bags:
            raise InputError("parameter history_bags: is empty; it names the folder for the bags")
        try:
            require_library()
        except InputError as error:
            raise InputError(f"parameter history: {error}") from error
        own = str(Path(given).expanduser().resolve()) if Path(given).is_file() else given
        return cls(url, machine, Path(bags).expanduser(), robot, own)

    def add(self, session: Session, fitted: FittedCalibration) -> str:
        """Write the bag and add it; a sentence, also of why that failed: a fit stays a fit."""
        try:
            return f"added to the history of {self.machine} as {self._added(session, fitted)}"
        except CalibrationError as error:
            return f"not added to the history of {self.machine}: {error}"

    def _added(self, session: Session, fitted: FittedCalibration) -> str:
        from delta_calibration.history.adding import document_of, entry_of
        from delta_calibration.history.bags import bag_hash
        from delta_calibration.history.store import BY_NODE

        began = datetime.fromtimestamp(fitted.poses.start_ns * 1e-9, timezone.utc)
        name = f"{began:{_TIME}}"
        bag = self.bags.resolve() / self.machine / name
        try:
            bag.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{bag.parent}: {error.strerror or error}") from error
        with opened(self.url, make=True) as store:
            if not bag.exists():  # fitted again, it is there
                write_session(bag, session)
            digest = bag_hash(str(bag))
            store.require_new(self.machine, self.robot.machine_hash, digest, str(bag), name)
            verdict = None if fitted.diagnosis is None else fitted.diagnosis.verdict.as_dict()
            entry = entry_of(
                self.machine,
                name,
                str(bag),
                digest,
                fitted.poses,
                document_of(lambda path: fitted.save(path, self.robot)),
                verdict,
                by=BY_NODE,
            )
            store.add(entry, self.given, self.robot.machine_hash)
        return name
