"""Detects small moves and joint offsets, which only a fit of the whole machine shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Poses, collect
from delta_calibration.doctor import hypotheses, moves, steps
from delta_calibration.doctor.change import Answer, joint_streams
from delta_calibration.doctor.checked import Checked
from delta_calibration.errors import CalibrationError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_ROUNDS = 4
_MOST_POSES = 800  # that are fitted; of more, so many evenly over the session
_LEAST_MOVE = 1e-3  # [m] of a tracker or reflector; less is a drift, which `diagnose` names
_LEFT_OF_MOVE = 0.25  # share of chi square that a move may leave
_TURNED = 6.0  # standard errors from which a rotation of the tracker is significant
_TILT = 2e-3  # [rad] to which a platform's tilt is known, by points alone
_APART = 1.5  # ratio of residuals from which the better explanation is preferred
_OFFSET_GAIN, _OFFSET_SIZE = 40.0, 0.02  # least gain in chi square; least size [rad of a Delta]
_KEPT = 0.5  # least share of the promised gain that a fit without the offset must reach
_TOLD = 4  # pairs of stops in a note
_REFINED = 4.0  # least gain in chi square to refine an offset found with the nominal robot


def fitted(checked: Checked) -> Checked:
    """Undo mistakes that only a fit of the whole machine shows, in rounds."""
    for _ in range(_ROUNDS):
        try:
            fitted = _fit(checked)
            if fitted is None:
                return checked
            again = _offset(checked, fitted) or _step(checked, fitted)
        except (CalibrationError, np.linalg.LinAlgError):
            return checked  # a later fit of this session reports the error itself
        if again is None:
            return replace(checked, notes=(*checked.notes, *_exchanged(fitted)))
        checked = again
    return checked


def _fit(checked: Checked) -> steps.Fitted | None:
    robot = checked.robot
    poses = collect(checked.session, robot.joints.names, robot.commanded.joint_size)
    if len(poses) < steps.FEWEST:
        return None
    if len(poses) > _MOST_POSES:
        poses = poses.take(np.linspace(0, len(poses) - 1, _MOST_POSES).astype(np.intp))
    return steps.Fitted(poses, robot)


def _exchanged(fitted: steps.Fitted) -> tuple[str, ...]:
    """A note of the neighbouring stops whose points seem to be exchanged."""
    time = fitted.poses.time
    pairs = [f"{time[k]:.1f} and {time[k + 1]:.1f} s" for k in fitted.exchanged()]
    if not pairs:
        return ()
    more = f", and {len(pairs) - _TOLD} more" if len(pairs) > _TOLD else ""
    return (
        f"the points of neighbouring stops seem exchanged: {'; '.join(pairs[:_TOLD])}{more} "
        "after the first reading; a fit leaves these stops out",
    )


def _offset(checked: Checked, fitted: steps.Fitted) -> Checked | None:
    """Undo a joint offset, or the remainder of one already found with the nominal robot."""
    offset = fitted.offset()
    robot, streams = checked.robot, joint_streams(checked.session)
    name = robot.joints.names[offset.joint]
    told = [m for m in checked.found if m.mistake == "joint_offset" and m.part == name]
    clear = offset.gain > max(_OFFSET_GAIN, 2 * offset.second)
    large = abs(offset.value) > _OFFSET_SIZE * robot.commanded.joint_size
    if not ((clear and large) or (told and offset.gain > _REFINED)):
        return None
    if not (_possible(robot, offset) and _holds(fitted, offset)):
        return None
    whole = offset.value + (told[0].value or 0.0 if told else 0.0)
    undone = hypotheses.offset_joint(robot, streams, offset.joint, offset.value)
    said = hypotheses.offset_joint(robot, streams, offset.joint, whole)
    evidence = (
        told[0].evidence
        if told
        else (
            "with this offset, the chi square of a fit of the whole machine is smaller by "
            f"{offset.gain:.0f}; an offset of any other joint lowers it by {offset.second:.0f} "
            "at most"
        )
    )
    rest = tuple(m for m in checked.found if m not in told)
    return replace(
        checked, found=(*rest, *said.found(evidence)), session=undone.undo(checked.session)
    )


def _possible(robot: Robot, offset: steps.Offset) -> bool:
    """Whether an offset is at most half a turn, of a joint that slides or pulls its range."""
    joints, most = robot.joints, np.pi
    if joints.unit != "rad" or robot.model().pulls:
        most = float(joints.upper[offset.joint] - joints.lower[offset.joint])
    return bool(abs(offset.value) <= most)


def _holds(fitted: steps.Fitted, offset: steps.Offset) -> bool:
    """Whether a fit without the offset explains the bulk of the poses as well as promised."""
    try:
        gain = fitted.lowered(fitted.without(offset))
    except (CalibrationError, np.linalg.LinAlgError):
        return False  # poses beyond reach
    return gain >= _KEPT * offset.gain


def _step(checked: Checked, fitted: steps.Fitted) -> Checked | None:
    """Undo a move of the tracker or a change of reflector; None if there is none."""
    step = fitted.step()
    first, left, shift = fitted.reflector()
    of_tracker = step.left <= left
    size = step.size if of_tracker else float(np.linalg.norm(shift))
    if size < _LEAST_MOVE or min(step.left, left) > _LEFT_OF_MOVE:
        return None
    if of_tracker:
        return _moved(
            checked, fitted.poses, step.first, step.moved, fitted.reflector(step.first)[2]
        )
    return _moved(checked, fitted.poses, first, fitted.step(first).moved, shift)


def _moved(checked: Checked, poses: Poses, first: int, moved: Frame, shift: Array) -> Checked:
    """Add a moved tracker or a changed reflector; name both if they are indistinguishable."""
    session, robot = checked.session, checked.robot
    found = steps.fitted_moves(poses, robot, first, moved, shift)
    at = poses.start_ns + round(0.5e9 * float(poses.time[first - 1] + poses.time[first]))
    tracker = moves.tracker_moved(session, at, found.moved, poses.point[first:])
    reflector = moves.reflector_changed(
        session, robot, at, found.shift, found.frame, found.geometry
    )
    turn = float(np.linalg.norm(rotations.log(found.moved.rotation)))
    spread = float(np.sqrt(np.var(poses.point, axis=0).sum()))
    tilted = _TILT * float(np.linalg.norm(found.shift))
    turned = turn > max(_TURNED * found.turn_std, tilted / spread)
    apart = found.reflector_left / found.tracker_left
    best, other, least = tracker, reflector, found.tracker_left
    if apart < 1 / _APART:
        best, other, least = reflector, tracker, found.reflector_left
    worst = max(found.reflector_left, found.tracker_left)
    unsure = not turned and (1 / _APART <= apart <= _APART or worst <= tilted)
    evidence = (
        f"from {moves.since(session, at):.1f} s on, {best.part}: a fit of the whole machine then "
        f"leaves {1e3 * least:.3g} mm (median)"
    )
    also = (other,) if unsure else ()
    return checked.answered(Answer((best,), evidence, also))


def answered_in_full(checked: Checked, answer: Answer) -> Checked:
    """Apply an answer; a move is first refined by a fit of the whole machine, if possible."""
    move = answer.changes[0]
    if not isinstance(move, moves.Move):
        return checked.answered(answer)
    robot = checked.robot
    try:
        poses = collect(checked.session, robot.joints.names, robot.commanded.joint_size)
        first = int(np.searchsorted(poses.start_ns + 1e9 * poses.time, move.at))
        if not steps.FEWEST // 4 <= first <= len(poses) - steps.FEWEST // 4:
            return checked.answered(answer)
        return _moved(checked, poses, first, move.moved, move.shift)
    except (CalibrationError, np.linalg.LinAlgError):
        return checked.answered(answer)
