"""Fit of a calibration to the session that a cell has captured."""

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
_LAST = 5  # number of poses whose errors are listed one by one


def silent(step: str) -> None:
    """Progress callback that does nothing."""


@dataclass(frozen=True)
class Known:
    """Prior knowledge of a machine before a fit, with messages and doubts about it."""

    carried: Carried | None = None  # None if only the drawing is known
    told: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


Ask = Callable[[Survey, str | None], Known]  # of a session and the mechanism that is fitted


def drawing_only(seen: Survey, model: str | None) -> Known:
    """Return no prior knowledge beyond the drawing."""
    return Known()


@dataclass(frozen=True)
class FittedCalibration:
    """Calibration with the poses and the identification, and the diagnosis if one was made."""

    found: Identification
    poses: Poses
    calibration: Calibration
    diagnosis: Diagnosis | None = None
    known: Known = Known()
    kept: str = ""  # sentence on whether it was added to the history

    def save(self, path: Path, robot: Robot) -> None:
        """Write the calibration file atomically.

        Raises:
            ConfigError: the file cannot be written.
        """
        save_calibration(path, self.found, robot, self.poses)

    def document(self, robot: Robot) -> dict[str, Any]:
        """Content of the calibration file."""
        return document_of(self.found, robot, self.poses)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts about the calibration, one sentence each; empty if there are none."""
        if self.diagnosis is not None:
            return self.diagnosis.doubts
        return (*self.known.doubts, *doubts(self.found))

    def last_errors(self) -> str:
        """Held-out errors of the poses measured last [mm], the newest at the end."""
        left = 1e3 * np.linalg.norm(self.found.missed[-_LAST:], axis=1)
        return ", ".join(mm(float(each)) for each in left)

    def sentence(self) -> str:
        """Result in one line: number of poses, rank, error left, noise of a pose and warnings."""
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
        seed: seed of the division into held-out parts.
        step: callback that gets each of `FIT_STEPS` when it begins, except the last.
        ask: function that returns the prior knowledge of the machine.

    Raises:
        MistakeError: the session was recorded with a mistake; says which and how to correct it.
        CalibrationError: the session does not determine a calibration; says why.
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
    """Identify the robot and extend its model by the effects that a session shows.

    Args:
        session: what was captured.
        robot: drawing, priors, tracker.
        model: name of a mechanism; the robot file's own where not given.
        seed: seed of the bootstraps.
        step: callback that gets each of `DIAGNOSIS_STEPS` when it begins, except the last.

    Raises:
        MistakeError: the session was recorded with a mistake; says which and how to correct it.
        CalibrationError: the session does not determine a calibration; says why.
    """
    step(CHECK)
    require_sound(session, robot)
    step(POSES)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    found = diagnose(seen, robot, model, seed=seed, step=step)
    calibration = from_identification(found.identification, robot, seen.poses)
    return FittedCalibration(found.identification, seen.poses, calibration, found)
