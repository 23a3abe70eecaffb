"""Hypotheses that the tracker was moved, or the reflector changed, during a session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Session, TrackerStream
from delta_calibration.doctor.change import TRACKER, Change, of_points
from delta_calibration.doctor.placing import Placed, place, place_poses, similarity
from delta_calibration.geometry import Frame, rotations
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_EDGE = 5  # stops on either side
_LEAST = 16  # stops
_ROUNDS = 3


@dataclass(frozen=True)
class Move(Change):
    """A change of station or reflector at a time; `moved` moves the tracker's points."""

    at: int = 0  # [ns]
    moved: Frame = field(default_factory=Frame.identity)
    shift: Array = field(default_factory=lambda: np.zeros(3))  # [m] of a reflector


def roughly(stops: Session, robot: Robot) -> tuple[Move, ...]:
    """Likeliest move of the tracker and likeliest change of reflector, by the nominal robot."""
    placed = place(stops, robot)
    tracker = stops.tracker
    if tracker is None or len(placed.pose) < _LEAST:
        return ()
    good = np.flatnonzero(np.isfinite(placed.pose).all(axis=1))
    if len(good) < _LEAST:
        return ()
    pose, point, stamps = placed.pose[good], tracker.position[good], tracker.stamp_ns[good]
    return (
        _moved_roughly(stops, robot, placed, (pose, point, stamps)),
        _changed_roughly(stops, robot, (pose, point, stamps)),
    )


Rows = tuple[Array, Array, NDArray[np.int64]]  # poses, points, stamps of the stops in reach


def _moved_roughly(stops: Session, robot: Robot, placed: Placed, rows: Rows) -> Move:
    """Likeliest move of the tracker: two frames, one reflector on the platform."""
    pose, point, stamps = rows
    model = robot.model()
    centre, turned = model.position(pose), model.rotation(pose)

    def apart(k: int) -> tuple[float, Frame, Frame]:
        offset, parts = placed.offset, (slice(0, k), slice(k, None))
        for _ in range(_ROUNDS):
            base = centre + turned @ offset
            before, after = (_frame(base[part], point[part]) for part in parts)
            predicted = np.concatenate([before.apply(base[:k]), after.apply(base[k:])])
            left = point - predicted
            if not placed.turns:
                break
            offset = offset + _better_offset((before, after), turned, predicted, left, k, robot)
        return float(np.sum(left**2)), before, after

    cuts = np.arange(_EDGE, len(pose) - _EDGE + 1, 2)
    best = int(cuts[int(np.argmin([apart(int(k))[0] for k in cuts]))])
    near = (k for k in (best - 1, best, best + 1) if _EDGE <= k <= len(pose) - _EDGE)
    k = min(near, key=lambda k: apart(k)[0])
    _, before, after = apart(k)
    return tracker_moved(stops, _between(stamps, k), after @ before.inverse(), point[k:])


def _better_offset(
    frames: tuple[Frame, Frame], turned: Array, predicted: Array, left: Array, k: int, robot: Robot
) -> Array:
    """Correction of the reflector's offset (3,) [m], with both frames free."""
    n = len(left)
    columns = np.zeros((n, 3, 15))
    for part, own, frame in ((slice(0, k), 0, frames[0]), (slice(k, n), 6, frames[1])):
        about = predicted[part] - predicted[part].mean(axis=0)
        columns[part, :, own : own + 3] = -rotations.skew(about)
        columns[part, :, own + 3 : own + 6] = np.eye(3)
        columns[part, :, 12:] = frame.rotation @ turned[part]
    sigma = np.sqrt(np.mean(left**2)) / robot.tracker.reflector_offset_prior
    rows = np.concatenate([columns.reshape(-1, 15), sigma * np.eye(15)[12:]])
    right = np.concatenate([left.reshape(-1), np.zeros(3)])
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-9)[0][12:])


def _changed_roughly(stops: Session, robot: Robot, rows: Rows) -> Move:
    """Likeliest change of reflector: linear in the offset, given the frame of the other part."""
    pose, point, stamps = rows
    model = robot.model()

    def apart(k: int) -> tuple[float, Array, Frame]:
        """Try the first and the second reflector as the file's own; return the better fit."""
        return min((by(k, first) for first in (True, False)), key=lambda found: found[0])

    def by(k: int, first: bool) -> tuple[float, Array, Frame]:
        part = slice(0, k) if first else slice(k, None)
        rest = slice(k, None) if first else slice(0, k)
        placed = place_poses(pose[part], point[part], robot)
        if not placed.found:
            return np.inf, np.zeros(3), placed.frame
        columns = placed.frame.rotation @ model.rotation(pose[rest])
        missed = point[rest] - placed.frame.apply(model.position(pose[rest]))
        offset = np.median(np.swapaxes(columns, 1, 2) @ missed[..., None], axis=0)[:, 0]
        left = np.linalg.norm(missed - columns @ offset, axis=1)
        every = np.concatenate([left, np.linalg.norm(placed.left, axis=1)])
        shift = (offset - placed.offset) * (1.0 if first else -1.0)
        return float(np.mean(np.minimum(every, 10 * np.median(every)))), shift, placed.frame

    coarse = np.arange(_EDGE, len(pose) - _EDGE + 1, 3)
    best = int(coarse[int(np.argmin([apart(int(k))[0] for k in coarse]))])
    near = range(max(_EDGE, best - 2), min(len(pose) - _EDGE, best + 2) + 1)
    k = min(near, key=lambda k: apart(k)[0])
    _, shift, frame = apart(k)
    return reflector_changed(
        stops, robot, _between(stamps, k), shift, frame, model.parameters.nominal
    )


def _between(stamps: NDArray[np.int64], k: int) -> int:
    return int(stamps[k - 1]) + (int(stamps[k]) - int(stamps[k - 1])) // 2


def _frame(base: Array, point: Array) -> Frame:
    rotation, _, shift = similarity(base, point, np.ones(len(base)))
    return Frame(rotation, shift)


def tracker_moved(session: Session, at: int, moved: Frame, point: Array) -> Move:
    """The tracker was moved at a time [ns]: later readings are `moved` applied to unmoved ones."""
    back = moved.inverse()
    size = float(np.sqrt(np.mean(np.sum((point - back.apply(point)) ** 2, axis=1))))
    turn = float(np.linalg.norm(rotations.log(moved.rotation)))
    when = since(session, at)
    return Move(
        "tracker_moved",
        (TRACKER,),
        _behind(at, lambda s: _back(s, back)),
        f"measure fixed reference reflectors to transform the readings after {when:.1f} s to the "
        "first station, or fit each part separately (--fix transforms the readings)",
        part=f"{1e3 * size:.2f} mm, {1e3 * turn:.3f} mrad",
        value=when,
        unit="s",
        at=at,
        moved=moved,
    )


def since(session: Session, at: int) -> float:
    """Time of a stamp since the tracker's first reading [s]."""
    tracker = session.tracker
    return 0.0 if tracker is None else float(at - int(tracker.stamp_ns[0])) * 1e-9


def _back(stream: TrackerStream, back: Frame) -> TrackerStream:
    turned = stream.quaternion
    if turned is not None:
        turned = rotations.to_quaternion(back.rotation @ rotations.from_quaternion(turned))
    return TrackerStream(stream.stamp_ns, back.apply(stream.position), turned)


def _behind(
    at: int, change: Callable[[TrackerStream], TrackerStream]
) -> Callable[[Session], Session]:
    """Function that changes the tracker's readings from a time [ns] on."""

    def undo(session: Session) -> Session:
        tracker = session.tracker
        if tracker is None:
            return session
        late = tracker.stamp_ns >= at
        changed = change(tracker)
        turned = tracker.quaternion
        if turned is not None and changed.quaternion is not None:
            turned = np.where(late[:, None], changed.quaternion, turned)
        point = np.where(late[:, None], changed.position, tracker.position)
        return replace(session, tracker=TrackerStream(tracker.stamp_ns, point, turned))

    return undo


def reflector_changed(
    session: Session, robot: Robot, at: int, shift: Array, frame: Frame, geometry: Array
) -> Move:
    """The reflector was changed at a time [ns]; `shift` (3,) [m] in the platform's frame.

    The orientation of the platform at each reading is computed with this geometry (p,).
    """

    def undo(session: Session) -> Session:
        tracker, joints = session.tracker, session.states or session.command
        if tracker is None or joints is None:
            return session
        columns = joints.position.T
        time, own = tracker.stamp_ns * 1e-9, joints.stamp_ns * 1e-9
        q = np.column_stack([np.interp(time, own, column) for column in columns])
        model = robot.model()
        turned = model.rotation(model.forward(q, geometry))
        moved = np.nan_to_num((frame.rotation @ turned) @ shift)
        late = (tracker.stamp_ns >= at)[:, None]
        return of_points(lambda p: p - np.where(late, moved, 0.0))(session)

    when = since(session, at)
    said = ", ".join(f"{1e3 * v:.2f}" for v in shift)
    return Move(
        "reflector_changed",
        (TRACKER,),
        undo,
        f"use one reflector, or fit the readings before and after {when:.1f} s separately; the "
        f"second reflector is [{said}] mm from the first in the platform frame (--fix corrects "
        "for it)",
        part=f"{1e3 * float(np.linalg.norm(shift)):.2f} mm",
        value=when,
        unit="s",
        at=at,
        shift=shift,
    )
