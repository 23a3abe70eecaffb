"""Joint commands for targets: what becomes of each, and how near it comes.

Shared by `delta-cal compensate` and notebooks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation import CommandStatus, Compensated, JointCompensator
from delta_calibration.data import Conditions, at_rest, motion_of
from delta_calibration.effects.catalogue import catalogue
from delta_calibration.errors import InputError, ReachError
from delta_calibration.plans.target_file import targets_of
from delta_calibration.robot import Robot
from delta_calibration.tables import Row

Array = NDArray[np.float64]
Say = Callable[[str], None]
Watch = Callable[[Sequence[NDArray[np.intp]]], Iterable[NDArray[np.intp]]]

BLENDED, UNREACHED = "blended", CommandStatus.OUT_OF_REACH.name.lower()
_BATCH = 64  # commands searched side by side
# Of the length of a vector of three alike normal numbers: its 95 % quantile over its RMS
# (chi with three degrees of freedom, 2.795 / sqrt 3).
_COVERS = 1.614


def silent(text: str) -> None:
    """Nobody is to be told."""


@dataclass(frozen=True)
class Commands:
    """What became of every target."""

    rows: Sequence[Row]  # (n,) as they came
    nominal: Array  # (n, m) [rad or m] NaN out of reach
    found: Compensated | None  # of the targets in reach; None where none is
    reached: NDArray[np.intp]  # (k,) which these are
    radius: Array  # (k,) [m] 95 % of corrected positions of those

    @property
    def status(self) -> list[str]:
        """Of every target."""
        status, found = [UNREACHED] * len(self.rows), self.found
        if found is not None:
            for k, row in enumerate(self.reached):
                verdict = found.verdicts[k]
                whole = verdict is not CommandStatus.CORRECTED or not found.blended(k)
                status[row] = verdict.name.lower() if whole else BLENDED
        return status

    @property
    def uncorrected(self) -> list[int]:
        """Targets whose command is nominal or none."""
        good = (CommandStatus.CORRECTED.name.lower(), BLENDED)
        return [row for row, status in enumerate(self.status) if status not in good]

    def by_target(self) -> tuple[Array, Array, Array | None]:
        """Joints to command (n, m), errors left (n,) by place and turn; NaN if there is none."""
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
        """Expanded uncertainty of where the tool comes to, (n,) [m]; NaN where not corrected.

        By what the fit leaves open there, how the joints come to rest and what the model leaves
        at places that it has not seen (`uncertainty.py`); and all that a correction blended out
        leaves by the model.
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
    """What becomes of every target, the machine stopping at one after the other.

    Args:
        compensator: of the calibration.
        rows: targets, (n,).
        payload: [kg] at the centre of the platform; None where it is not known.
        warm: temperatures [deg C] by part.
        calibration_file: what messages call the calibration.
        say: is told what to know of the result.
        watched: goes through the parts of the work, and may tell how far it is.

    Raises:
        InputError: a target that is none, or the calibration takes a condition that is not given.
    """
    calibration = compensator.calibration
    nominal = _nominal(calibration.robot, rows, payload or 0.0)
    reached = np.flatnonzero(np.isfinite(nominal).all(axis=1))
    if not reached.size:
        return Commands(rows, nominal, None, reached, np.zeros(0))
    found = found_for(compensator, nominal[reached], payload, warm, calibration_file, watched)
    radius = _radius(calibration, found, payload, warm, say)
    return Commands(rows, nominal, found, reached, radius)


def _radius(
    calibration: Calibration,
    found: Compensated,
    payload: float | None,
    warm: dict[str, float],
    say: Say,
) -> Array:
    """Within how far of their targets corrected commands bring the tool with 95 %, (k,) [m]."""
    identified = calibration.identified
    if identified is None:
        say(
            "u95_mm is the same everywhere, computed from the error left alone: the calibration "
            "was written by an older version; fit again"
        )
        return np.full(len(found.joint), _COVERS * calibration.held_out)
    at = _conditions(found.joint, payload, warm, calibration.robot.commanded.joint_size)
    return identified.radius(at)


def found_for(
    compensator: JointCompensator,
    nominal: Array,
    payload: float | None,
    warm: dict[str, float],
    calibration_file: Path,
    watched: Watch = iter,
) -> Compensated:
    """What becomes of all commands (n, m), the machine stopping at one after the other.

    Raises:
        InputError: the calibration takes a condition that is not given.
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
    """Joints that the drawing takes for targets, (n, m) [rad or m]; NaN out of reach."""
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
    """Temperatures [deg C] by part, of parts that the robot has or the calibration goes by.

    Raises:
        InputError: another part, or one twice.
    """
    asked, known = _sensors(calibration)
    by_part: dict[str, float] = {}
    for part, celsius in given:
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
    """Parts whose temperature the calibration goes by, and with them all that can grow."""
    asked = {str(effect.settings.get("sensor", "")) for effect, _ in calibration.live} - {""}
    effects = catalogue(calibration.robot, calibration.chain.mechanism)
    growing = {effect.part for effect in effects if effect.part}
    return asked, sorted(asked | growing)


def _conditions(
    joint: Array, payload: float | None, warm: dict[str, float], joint_size: float
) -> Conditions:
    """Stops at joints (n, m) [rad], one after the other."""
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
