"""Compensated joint commands for targets, with the status and expected error of each.

Shared by `delta-cal compensate` and notebooks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.bounds import CELSIUS, PAYLOAD, require_within
from delta_calibration.calibration import Calibration
from delta_calibration.compensation import CommandStatus, Compensated, JointCompensator
from delta_calibration.compensation.task_coordinates import TaskCoordinates
from delta_calibration.data import Conditions, at_rest, motion_of
from delta_calibration.effects.catalogue import catalogue
from delta_calibration.errors import InputError, ReachError
from delta_calibration.geometry import rotations
from delta_calibration.plans.target_file import targets_of
from delta_calibration.robot import Robot
from delta_calibration.tables import Row
from delta_calibration.uncertainty import Identified

Array = NDArray[np.float64]
Say = Callable[[str], None]
Watch = Callable[[Sequence[NDArray[np.intp]]], Iterable[NDArray[np.intp]]]

BLENDED, UNREACHED = "blended", CommandStatus.OUT_OF_REACH.name.lower()
_BATCH = 64  # commands computed together, at least (if there are as many)
_FEWEST = 20  # of them have to be corrected
_AROUND = 200  # commands over the measured joints that show how the whole machine lies
# 95 % quantile over RMS of the length of a vector of three independent normal numbers of equal
# variance (chi with three degrees of freedom, 2.795 / sqrt 3).
_COVERS = 1.614


def silent(text: str) -> None:
    """Message callback that does nothing."""


@dataclass(frozen=True)
class Commands:
    """Commands for a list of targets, with the outcome for each."""

    rows: Sequence[Row]  # (n,) targets in the given order
    nominal: Array  # (n, m) [rad or m] nominal joints; NaN out of reach
    found: Compensated | None  # commands for the k targets in reach; None if k is 0
    reached: NDArray[np.intp]  # (k,) rows of the targets in reach
    radius: Array  # (k,) [m] radius that holds 95 % of the positions after correction

    @property
    def status(self) -> list[str]:
        """Status of every target, in words, (n,)."""
        status, found = [UNREACHED] * len(self.rows), self.found
        if found is not None:
            for k, row in enumerate(self.reached):
                verdict = found.verdicts[k]
                whole = verdict is not CommandStatus.CORRECTED or not found.blended(k)
                status[row] = verdict.name.lower() if whole else BLENDED
        return status

    @property
    def uncorrected(self) -> list[int]:
        """Rows of the targets that have a nominal command or none."""
        good = (CommandStatus.CORRECTED.name.lower(), BLENDED)
        return [row for row, status in enumerate(self.status) if status not in good]

    def by_target(self) -> tuple[Array, Array, Array | None]:
        """Commands (n, m), predicted errors left (n,) in position [m] and rotation [rad], or NaN.

        The last is None if the joints do not command the rotation, or no target is in reach.
        """
        sent, left = self.nominal.copy(), np.full(len(self.rows), np.nan)
        found, rows = self.found, self.reached
        if found is None:
            return sent, left, None
        good = np.array([verdict is CommandStatus.CORRECTED for verdict in found.verdicts])
        sent[rows[good]], left[rows[good]] = found.joint[good], found.model_error[good]
        if found.model_turn is None:
            return sent, left, None
        turn = np.full(len(left), np.nan)
        turn[rows[good]] = found.model_turn[good]
        return sent, left, turn

    def u95(self) -> Array:
        """Expanded uncertainty (95 %) of the tool position, (n,) [m]; NaN where not corrected.

        It covers the parameters' covariance, the joints' repeatability and the model discrepancy
        at places that were not measured (`uncertainty.py`), plus the whole predicted error that
        remains where a correction fades out, and in directions that no joint commands.
        """
        u95 = np.full(len(self.rows), np.nan)
        if self.found is not None:
            u95[self.reached] = self.radius + self.found.model_error
        u95[self.uncorrected] = np.nan
        return u95


def commands_for(
    compensator: JointCompensator,
    rows: Sequence[Row],
    payload: float | None,
    warm: dict[str, float],
    calibration_file: Path,
    say: Say = silent,
    watched: Watch = iter,
) -> Commands:
    """Compute compensated commands for targets at which the machine stops one after the other.

    Args:
        compensator: compensator of the calibration.
        rows: targets, (n,).
        payload: [kg] at the centre of the platform; None if not known.
        warm: temperatures [deg C] by part.
        calibration_file: name of the calibration in messages.
        say: callback for notes on the result.
        watched: iterates over the batches; may show progress.

    Raises:
        InputError: an invalid target, or the calibration needs a condition that is not given.
    """
    calibration = compensator.calibration
    if payload is not None:
        require_within("payload", payload, PAYLOAD, "kg")
    nominal = _nominal(calibration.robot, rows, payload or 0.0)
    reached = np.flatnonzero(np.isfinite(nominal).all(axis=1))
    if not reached.size:
        return Commands(rows, nominal, None, reached, np.zeros(0))
    found = found_for(compensator, nominal[reached], payload, warm, calibration_file, watched)
    radius = _radius(compensator, found, payload, warm, say)
    return Commands(rows, nominal, found, reached, radius)


def _radius(
    compensator: JointCompensator,
    found: Compensated,
    payload: float | None,
    warm: dict[str, float],
    say: Say,
) -> Array:
    """Radius about the targets that holds 95 % of the corrected positions, (k,) [m]."""
    calibration = compensator.calibration
    identified = calibration.identified
    if identified is None:
        say(
            "u95_mm is the same everywhere, computed from the error left only: the calibration "
            "was written by an older version; fit again"
        )
        return np.full(len(found.joint), _COVERS * calibration.held_out)
    at = _conditions(found.joint, payload, warm, calibration.robot.commanded.joint_size)
    return identified.radius(at) + _uncommanded(compensator, identified.machine, found, at, say)


def _uncommanded(
    compensator: JointCompensator,
    machine: Identified,
    found: Compensated,
    at: Conditions,
    say: Say,
) -> Array:
    """Predicted error of corrected commands in directions that no joint commands, (n,) [m].

    A SCARA whose axes are not parallel rises and falls over its region: its joints cannot correct
    that. A motion of the whole machine, as the tracker's frame has it, is no error.
    """
    robot, calibration = compensator.robot, compensator.calibration
    commanded = TaskCoordinates.of(robot.commanded, robot.tool_offset).axes
    free = [axis for axis in range(3) if axis not in commanded]
    if not free:
        return np.zeros(len(at))
    lower, upper = calibration.joints_lower, calibration.joints_upper
    q = np.random.default_rng(0).uniform(lower, upper, (_AROUND, len(lower)))
    around = replace(at.take(np.zeros(_AROUND, dtype=np.intp)), joint=q)
    there = compensator.compensate(q, around)
    missed, moved = _missed(robot, machine, there, around)
    known = [row for row in range(_AROUND) if there.whole(row) and np.isfinite(missed[row]).all()]
    if len(known) < _FEWEST:
        say(
            f"u95_mm leaves out errors in directions that the joints do not command: only "
            f"{len(known)} of {_AROUND} commands in the measured range can be corrected"
        )
        return np.zeros(len(at))
    rows = moved[known][:, free].reshape(-1, 6)
    whole = np.linalg.lstsq(rows, missed[known][:, free].reshape(-1), rcond=None)[0]
    missed, moved = _missed(robot, machine, found, at)
    return np.asarray(np.linalg.norm((missed - moved @ whole)[:, free], axis=1))


def _missed(
    robot: Robot, machine: Identified, found: Compensated, at: Conditions
) -> tuple[Array, Array]:
    """Predicted errors of the tool, (n, 3) [m], and those by small motions of the base (n, 3, 6).

    The motions are shifts along x, y, z [m] and turns about them [rad], of the whole machine.
    """
    drawn, tool, chain = robot.commanded, robot.tool_offset, machine.chain
    nominal = drawn.forward(found.joint - found.correction, drawn.parameters.nominal)
    meant = drawn.points(nominal, tool)
    pose = chain.pose(replace(at, joint=found.joint), machine.theta)
    shifts = np.broadcast_to(np.eye(3), (len(meant), 3, 3))
    moved = np.concatenate([shifts, -rotations.skew(meant)], axis=2)
    return chain.point(pose, tool) - meant, moved


def found_for(
    compensator: JointCompensator,
    nominal: Array,
    payload: float | None,
    warm: dict[str, float],
    calibration_file: Path,
    watched: Watch = iter,
) -> Compensated:
    """Compensate nominal commands (n, m) at which the machine stops one after the other.

    Raises:
        InputError: the calibration needs a condition that is not given.
    """
    calibration = compensator.calibration
    at = _conditions(nominal, payload, warm, calibration.robot.commanded.joint_size)
    parts = np.array_split(np.arange(len(nominal)), max(len(nominal) // _BATCH, 1))
    found = Compensated.joined(
        [compensator.compensate(nominal[rows], at.take(rows)) for rows in watched(parts)]
    )
    _refuse_unknown(found, calibration_file)
    return found


def _nominal(robot: Robot, rows: Sequence[Row], payload: float) -> Array:
    """Joints of targets by nominal inverse kinematics, (n, m) [rad or m]; NaN out of reach."""
    try:
        return targets_of(rows, robot, payload).joint
    except ReachError:
        return np.concatenate([_one_nominal(row, robot, payload) for row in rows])


def _one_nominal(row: Row, robot: Robot, payload: float) -> Array:
    try:
        return targets_of([row], robot, payload).joint
    except ReachError:
        return np.full((1, len(robot.joints.names)), np.nan)


def warmth_by_part(
    given: Sequence[tuple[str, float]], calibration: Calibration, say: Say = silent
) -> dict[str, float]:
    """Check given temperatures [deg C] and return them by part.

    Raises:
        InputError: a part that neither the robot nor the calibration has, a part given twice, or
            a temperature that none can be.
    """
    asked, known = _sensors(calibration)
    by_part: dict[str, float] = {}
    for part, celsius in given:
        require_within(f"temperature of {part}", celsius, CELSIUS, "deg C")
        if part not in known:
            parts = ", ".join(known) or "none"
            raise InputError(
                f"--temperature {part}={celsius:g}: robot {calibration.robot.name} has no part "
                f"{part!r} that grows; there are: {parts}"
            )
        if part in by_part:
            raise InputError(
                f"--temperature {part}={celsius:g}: {part} was already given as {by_part[part]:g}"
            )
        if part not in asked:
            say(
                f"the calibration has no growth of {part}: --temperature {part}={celsius:g} "
                "changes nothing"
            )
        by_part[part] = celsius
    return by_part


def _sensors(calibration: Calibration) -> tuple[set[str], list[str]]:
    """Parts whose temperature the calibration uses; those and all parts that can expand."""
    asked = {part for effect, _ in calibration.live for part in effect.sensors}
    effects = catalogue(calibration.robot, calibration.chain.mechanism)
    growing = {effect.part for effect in effects if effect.part}
    return asked, sorted(asked | growing)


def _conditions(
    joint: Array, payload: float | None, warm: dict[str, float], joint_size: float
) -> Conditions:
    """Conditions of stops at joints (n, m) [rad or m], one after the other."""
    n = len(joint)
    stops = motion_of(np.arange(n, dtype=float), joint, joint_size)
    at = replace(at_rest(joint), direction=stops.direction, travel=stops.travel)
    if payload is not None:
        at = replace(at, payload=np.full(n, payload), payload_centre=np.zeros((n, 3)))
    celsius = np.tile(np.array(list(warm.values()), dtype=float), (n, 1))
    return replace(at, temperature_parts=tuple(warm), temperature=celsius)


def _refuse_unknown(found: Compensated, file: Path) -> None:
    if found.missing:
        raise InputError(
            f"{file}: the calibration contains effects that need a condition: {found.missing}; "
            "give it by --payload KG or --temperature PART=DEGREES"
        )
