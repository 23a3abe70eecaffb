"""Access to the history of a machine: reads prior knowledge for a fit and stores new fits."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from delta_calibration.cell.fitting import FittedCalibration, Known
from delta_calibration.data import Poses, Session, Survey
from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.history import Prospect, prospect
from delta_calibration.history.few import is_few
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
    given: str  # the robot's file or name, as given to the node
    update: bool = False  # use the history in the fit of every session, not only of short ones

    @classmethod
    def of(
        cls, url: str, machine: str, bags: str, robot: Robot, given: str, update: bool = False
    ) -> Archive | None:
        """Archive made from the node's parameters; None if they name no history.

        Raises:
            InputError: a history without a machine or a bag folder, an update without a history,
                or the library for it is missing.
        """
        if not url and update:
            raise InputError("parameter history_update: needs the parameter history")
        if not url:
            return None
        if not machine:
            raise InputError(
                "parameter machine: is empty; the history needs the name of the machine"
            )
        if not bags:
            raise InputError("parameter history_bags: is empty; it names the folder for the bags")
        try:
            require_library()
        except InputError as error:
            raise InputError(f"parameter history: {error}") from error
        own = str(Path(given).expanduser().resolve()) if Path(given).is_file() else given
        return cls(url, machine, Path(bags).expanduser(), robot, own, update)

    def known(self, seen: Survey, model: str | None) -> Known:
        """Return the prior knowledge for the fit of a session.

        The history is used for sessions with few places, and for all sessions if `update` is set.
        A full session is fitted without the history if that cannot be used; the result says so.

        Raises:
            CalibrationError: the session has few places, and nothing is known of the machine.
        """
        few = is_few(seen)
        if not few and not self.update:
            return Known()
        name = _named(seen.poses)
        try:
            expected = self._expected(name, seen, model)
        except CalibrationError as error:
            if few:
                raise
            return Known(told=(f"fitted without the history of {self.machine}: {error}",))
        doubts = (expected.doubt,) if expected.doubt else ()
        return Known(expected.carried, expected.sentences(name), doubts)

    def _expected(self, name: str, seen: Survey, model: str | None) -> Prospect:
        from delta_calibration.history.adding import newly, read_again

        with opened(self.url) as store:
            store.require_robot(self.machine, self.robot.machine_hash)
            entries = store.sessions(self.machine)
        old = [read_again(entry, self.robot) for entry in entries]
        return prospect(old, self.robot, newly(name, seen), model)

    def add(self, session: Session, fitted: FittedCalibration) -> str:
        """Write the bag, add it to the history and say so; a failure is told, but not raised."""
        try:
            return f"added to the history of {self.machine} as {self._added(session, fitted)}"
        except CalibrationError as error:
            return f"not added to the history of {self.machine}: {error}"

    def _added(self, session: Session, fitted: FittedCalibration) -> str:
        from delta_calibration.history.adding import entry_of
        from delta_calibration.history.bags import bag_hash
        from delta_calibration.history.store import BY_NODE

        name = _named(fitted.poses)
        bag = self.bags.resolve() / self.machine / name
        try:
            bag.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{bag.parent}: {error.strerror or error}") from error
        with opened(self.url, make=True) as store:
            if not bag.exists():  # it exists if the session is fitted again
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
                fitted.document(self.robot),
                verdict,
                by=BY_NODE,
            )
            store.add(entry, self.given, self.robot.machine_hash)
        return name


def _named(poses: Poses) -> str:
    """Id of a session in the history: its start time (UTC)."""
    return f"{datetime.fromtimestamp(poses.start_ns * 1e-9, timezone.utc):{_TIME}}"
