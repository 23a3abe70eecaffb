"""Make the report of a session that has been read and diagnosed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from delta_calibration.accuracy import IsoReport, evaluate
from delta_calibration.calibration import Calibration
from delta_calibration.data import Session, collect, match
from delta_calibration.diagnosis import Diagnosis
from delta_calibration.doctor import Mistake
from delta_calibration.errors import CalibrationError
from delta_calibration.iso9283 import DELTA_PAPER, STANDARD
from delta_calibration.report import Report, hash_of, report_of, session_provenance
from delta_calibration.report.document import Statement
from delta_calibration.robot import Robot


def report_on(
    path: Path,
    session: Session,
    found: Diagnosis,
    robot: Robot,
    seed: int,
    calibration: Calibration | None = None,
    cycles: tuple[Path, Session] | None = None,
    mistakes: Sequence[Mistake] = (),
) -> Report:
    """Report of a diagnosed session, with ISO 9283 if its cycles were recorded.

    Args:
        path: of the session, for its hash.
        session: what was read from it.
        found: its diagnosis.
        robot: nominal dimensions, tolerances, tracker.
        seed: of the diagnosis.
        calibration: in force while it was recorded, if one was.
        cycles: another session with the standard's cycles; `session` if not given.
        mistakes: found in the session; the page states them first.

    Raises:
        RecordingError: a file of the session cannot be read.
    """
    poses = found.model.survey.poses
    provenance = session_provenance(path, poses, robot, seed, session.metadata, calibration)
    of_cycles = session
    if cycles is not None:
        also, of_cycles = cycles
        provenance = replace(provenance, cycles=also.name, cycles_sha256=hash_of(also))
    made = report_of(found, robot, provenance, _standard(of_cycles, robot, calibration))
    if not mistakes:
        return made
    told = ". ".join(mistake.sentence() for mistake in mistakes)
    first = Statement("Mistake in the session", f"{told}. The results below are not reliable.")
    return replace(made, statements=(first, *made.statements))


def _standard(session: Session, robot: Robot, calibration: Calibration | None) -> IsoReport | str:
    """ISO 9283 criteria by the standard's cycles, else by the paper's, or the reason for none."""
    names = robot.joints.names
    size = robot.commanded.joint_size
    poses, readings = collect(session, names, size), match(session, names, size)
    why = ""
    for conditions in (STANDARD, DELTA_PAPER):
        try:
            return evaluate(poses, readings, robot, conditions, calibration)
        except CalibrationError as error:
            why = why or str(error)
    return why
