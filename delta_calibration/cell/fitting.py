"""From what a cell captured to a calibration it can compensate by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import (
    document_of,
    from_identification,
    save_calibration,
)
from delta_calibration.data import Poses, Session, Survey, survey
from delta_calibration.diagnosis import STEPS, Diagnosis, diagnose
from delta_calibration.doctor import require_sound
from delta_calibration.estimation import Carried, Identification, doubts, identify
from delta_calibration.robot import Robot
from delta_calibration.wording import mm

CHECK, POSES, GEOMETRY, COMPENSATOR = "check", "still moments", "geometry", "compensator"
FIT_STEPS = (CHECK, POSES, GEOMETRY, COMPENSATOR)
DIAGNOSIS_STEPS = (CHECK, POSES, *STEPS, COMPENSATOR)
Step = Callable[[str], None]
_LAST = 5  # poses whose errors are told one by one


def silent(step: str) -> None:
    """Nobody asks how far it is."""


@dataclass(frozen=True)
class Known:
    """What is known of a machine before a fit, and sentences on it."""

    carried: Carried | None = None  # None where the drawing is all
    told: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


Ask = Callable[[Survey, str | None], Known]  # of a session and the mechanism that is fitted


def drawing_only(seen: Survey, model: str | None) -> Known:
    """Nothing is known of the machine but its drawing."""
    return Known()


@dataclass(frozen=True)
class FittedCalibration:
    """A calibration with what it was made from; by a diagnosis where there is one."""

    found: Identification
    poses: Poses
    calibration: Calibration
    diagnosis: Diagnosis | None = None
    known: Known = Known()
    kept: str = ""  # what became of it in the history, as a sentence

    def save(self, path: Path, robot: Robot) -> None:
        """Write the calibration file, whole or not at all.

        Raises:
            ConfigError: the file cannot be written.
        """
        save_calibration(path, self.found, robot, self.poses)

    def document(self, robot: Robot) -> dict[str, Any]:
        """What its file would hold."""
        return document_of(self.found, robot, self.poses)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What to know before it is relied on, a sentence each; none where all is well."""
        if self.diagnosis is not None:
            return self.diagnosis.doubts
        return (*self.known.doubts, *doubts(self.found))

    def last_errors(self) -> str:
        """Held-out errors of the poses measured last [mm], the newest at the end."""
        left = 1e3 * np.linalg.norm(self.found.missed[-_LAST:], axis=1)
        return ", ".join(mm(float(each)) for each in left)

    def sentence(self) -> str:
        """The result in a line: rank, the error left and the noise beside it."""
        found, seen = self.found, self.found.observability
        noise = f"noise of a pose: {mm(1e3 * found.noise.floor)} mm"
        warning = "".join(f"; warning: {text}" for text in self.doubts)
        warning += "".join(f"; {text}" for text in (*self.known.told, self.kept) if text)
        if self.diagnosis is not None:
            told = self.diagnosis.verdict.sentence().removesuffix(".")
            return f"{len(self.poses)} poses; {told}; {noise}{warning}"
        return (
            f"{len(self.poses)} poses, rank {seen.rank} of {seen.columns} parameters; "
            f"error left {mm(1e3 * found.frame_only.held_out)} mm before, "
            f"{mm(1e3 * found.full.held_out)} mm calibrated; {noise}{warning}"
        )


def fit(
    session: Session,
    robot: Robot,
    model: str | None,
    seed: int,
    step: Step = silent,
    ask: Ask = drawing_only,
) -> FittedCalibration:
    """Find the still moments of a session and identify the robot from them.

    Args:
        session: what was captured.
        robot: drawing, priors, tracker.
        model: name of a mechanism; the robot file's own where not given.
        seed: of the division into held-out parts.
        step: is told of each of `FIT_STEPS` as it begins, but for the last.
        ask: says what is known of the machine beforehand.

    Raises:
        MistakeError: the session was recorded with a mistake; says which and what mends it.
        CalibrationError: the session does not hold the answer; says why.
    """
    step(CHECK)
    require_sound(session, robot)
    step(POSES)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    known, poses = ask(seen, model), seen.poses
    step(GEOMETRY)
    found = identify(poses, robot, model, seed, carried=known.carried)
    return FittedCalibration(found, poses, from_identification(found, robot, poses), known=known)


def diagnosed(
    session: Session, robot: Robot, model: str | None, seed: int, step: Step = silent
) -> FittedCalibration:
    """Identify the robot and extend its model by what a session shows to be missing.

    Args:
        session: what was captured.
        robot: drawing, priors, tracker.
        model: name of a mechanism; the robot file's own where not given.
        seed: of bootstraps.
        step: is told of each of `DIAGNOSIS_STEPS` as it begins, but for the last.

    Raises:
        MistakeError: the session was recorded with a mistake; says which and what mends it.
        CalibrationError: the session does not hold the answer; says why.
    """
    step(CHECK)
    require_sound(session, robot)
    step(POSES)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    found = diagnose(seen, robot, model, seed=seed, step=step)
    calibration = from_identification(found.identification, robot, seen.poses)
    return FittedCalibration(found.identification, seen.poses, calibration, found)
