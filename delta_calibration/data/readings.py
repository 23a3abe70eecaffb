"""Tracker readings matched with joint angles by time stamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data.streams import JointStream, Session, TrackerStream
from delta_calibration.errors import DataError, RecordingError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SHORT_GAP = 0.25  # [s] gap between joint messages that may be interpolated
_NEAR = 0.05  # [s] a single joint message this close to a reading belongs to it
_FROZEN = 3  # so many equal readings in a row are a frozen value, not measurements
_HELD = 1e-6  # [rad of a Delta] joints that are equal to this on both sides of a gap were held
_OFTEN = 0.06  # [s] commands closer than this show reversals of joints on the way to a stop


@dataclass(frozen=True)
class Rejected:
    """Readings set aside, by reason; the keys of the verdict's `rejected`."""

    repeated: int = 0  # a stamp seen before
    frozen: int = 0  # the tracker repeats its last value
    unmatched: int = 0  # no joint angles near in time
    outlier: int = 0  # far from the others of its still moment
    settling: int = 0  # the platform had not come to rest

    def counts(self) -> dict[str, int]:
        """Number of readings set aside, by reason."""
        return dict(vars(self))


@dataclass(frozen=True)
class Readings:
    """Each tracker reading with the joint angles at its stamp."""

    start_ns: int  # stamp of time zero [ns]
    time: Array  # (n,) [s] since start_ns, strictly increasing
    joint: Array  # (n, m) [rad] by the encoders; by the command where there are no encoders
    command: Array  # (n, m) [rad]; the encoders' if none were recorded, NaN where none is near
    # (n, m) [rad] commanded path length of each joint since the first, in both directions: a short
    # move back and forth may lie between two readings, which are less frequent than commands
    gone: Array
    point: Array  # (n, 3) [m] in the tracker's frame
    quaternion: Array | None  # (n, 4)
    rejected: Rejected
    notes: tuple[str, ...]

    def take(self, keep: Mask | NDArray[np.intp]) -> Readings:
        """Some of the readings, counts and notes unchanged."""
        quaternion = None if self.quaternion is None else self.quaternion[keep]
        return Readings(
            self.start_ns,
            self.time[keep],
            self.joint[keep],
            self.command[keep],
            self.gone[keep],
            self.point[keep],
            quaternion,
            self.rejected,
            self.notes,
        )


def match(session: Session, joint_names: Sequence[str], joint_size: float = 1.0) -> Readings:
    """Interpolate the joint angles at the tracker's stamps.

    Between joint messages at most 0.25 s apart the angles are interpolated linearly at the
    reading's stamp, not taken from the nearest message. Across longer gaps a reading is used only
    if a joint message lies within 0.05 s, or if the joints have equal angles on both sides.

    Args:
        session: the recorded streams.
        joint_names: the robot's joints, in its order.
        joint_size: displacement, in the joints' unit, that corresponds to 1 rad of a Delta.

    Raises:
        RecordingError: no joints or no tracker in the session, or joints of other names.
        DataError: no reading has joint angles near it in time.
    """
    tracker, states = session.tracker, session.states or session.command
    if tracker is None or states is None:
        missing = "tracker readings" if tracker is None else "joint angles"
        raise RecordingError(f"{session.source}: no {missing} in this session")
    notes = list(session.notes)
    if session.states is None:
        notes.append(
            "no joint_states recorded: the commanded joints are used instead of measured ones"
        )
    stamps, kept, repeated = _in_order(tracker.stamp_ns)
    frozen = repeats(tracker.position[kept])
    kept, stamps = kept[~frozen], stamps[~frozen]
    held = _HELD * joint_size
    joint, known = _at(_ordered(states, joint_names, session.source), stamps, held)
    command, gone = joint, np.abs(np.diff(joint, axis=0, prepend=joint[:1])).cumsum(axis=0)
    if session.command is not None:
        stream = _ordered(session.command, joint_names, session.source)
        commanded, also = _at(stream, stamps, held)
        command = np.where(also[:, None], commanded, np.nan)
        gone, _ = _at(_distance(stream), stamps, held)
        if not _led_up_to(stream, tracker.stamp_ns):
            notes += _seldom(stream)
    if not known.any():
        raise DataError(
            f"{session.source}: no tracker reading has joint values at nearly the same time: "
            f"joints {_span(states.stamp_ns)}, tracker {_span(tracker.stamp_ns)}"
        )
    rejected = Rejected(repeated, int(frozen.sum()), int((~known).sum()))
    parts = joint, command, gone
    return _readings(tracker, kept, stamps, parts, rejected, notes).take(known)


def _readings(
    tracker: TrackerStream,
    kept: NDArray[np.intp],
    stamps: NDArray[np.int64],
    joints: tuple[Array, Array, Array],
    rejected: Rejected,
    notes: list[str],
) -> Readings:
    start = int(stamps[0]) if len(stamps) else 0
    quaternion = None if tracker.quaternion is None else tracker.quaternion[kept]
    time = np.asarray((stamps - start) * 1e-9, dtype=np.float64)
    return Readings(
        start, time, *joints, tracker.position[kept], quaternion, rejected, tuple(notes)
    )


def _distance(command: JointStream) -> JointStream:
    """Stream of each joint's path length since the start, instead of its position."""
    stamps, rows, _ = _in_order(command.stamp_ns)
    position = command.position[rows]
    gone = np.abs(np.diff(position, axis=0, prepend=position[:1])).cumsum(axis=0)
    return JointStream(stamps, command.names, gone)


def _seldom(command: JointStream) -> list[str]:
    """A note if joints may reverse unnoticed between two commands."""
    step = float(np.median(np.diff(command.stamp_ns))) * 1e-9 if len(command.stamp_ns) > 1 else 0.0
    if step <= _OFTEN:
        return []
    return [f"commands {step:.2g} s apart: a reversal of a joint in between is not detected"]


def _led_up_to(command: JointStream, read: NDArray[np.int64]) -> bool:
    """Whether one command leads up to each reading, as where a table states the directions.

    There is then a command at each reading, and between it and the reading before a single further
    one, short of the stop.
    """
    stamps, commands = np.unique(read), np.setdiff1d(command.stamp_ns, read)
    if not np.isin(stamps, command.stamp_ns).all():
        return False
    between = np.diff(np.searchsorted(commands, stamps), prepend=0)
    return len(stamps) > 0 and bool((between > 0).all() and np.median(between) == 1)


def _ordered(stream: JointStream, names: Sequence[str], source: str) -> JointStream:
    """The stream with its columns in the robot's order."""
    missing = [name for name in names if name not in stream.names]
    if missing:
        raise RecordingError(
            f"{source}: joints {', '.join(stream.names)} recorded, but the robot has "
            f"{', '.join(names)}: is it the session of another robot, or do the joints have "
            "other names?"
        )
    columns = [stream.names.index(name) for name in names]
    return JointStream(stream.stamp_ns, tuple(names), stream.position[:, columns])


def _in_order(stamps: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.intp], int]:
    """Sorted unique stamps, their rows, and the number of repeated stamps left out."""
    unique, rows = np.unique(stamps, return_index=True)
    return unique, rows, len(stamps) - len(unique)


def repeats(position: Array) -> Mask:
    """Whether each reading (n, 3) repeats a frozen value, (n,).

    A value is frozen if three or more readings in a row are equal; the first of them counts.
    """
    same = np.r_[False, (np.diff(position, axis=0) == 0).all(axis=1)]
    run = np.cumsum(~same)
    length = np.bincount(run)
    return np.asarray(same & (length[run] >= _FROZEN))


def _at(stream: JointStream, stamps: NDArray[np.int64], least: float) -> tuple[Array, Mask]:
    """Angles at the given stamps, (n, m), and mask of those that are known.

    Joints that differ by at most `least` on both sides of a gap were held.
    """
    own, rows, _ = _in_order(stream.stamp_ns)
    position = stream.position[rows]
    after = np.searchsorted(own, stamps, side="left").clip(0, len(own) - 1)
    exact = own[after] == stamps
    before = np.where(exact, after, after - 1).clip(0)
    gap = (own[after] - own[before]) * 1e-9
    inside = (own[before] <= stamps) & (stamps <= own[after])
    share = np.divide((stamps - own[before]) * 1e-9, gap, out=np.zeros(len(stamps)), where=gap > 0)
    between = position[before] + share[:, None] * (position[after] - position[before])
    held = np.abs(position[after] - position[before]).max(axis=1) <= least
    nearer = np.where(np.abs(own[after] - stamps) <= np.abs(own[before] - stamps), after, before)
    near = np.abs(own[nearer] - stamps) * 1e-9 <= _NEAR
    smooth = inside & ((gap <= _SHORT_GAP) | held)
    return np.where(smooth[:, None], between, position[nearer]), smooth | near


def _span(stamps: NDArray[np.int64]) -> str:
    if len(stamps) == 0:
        return "none"
    return f"{stamps.min() * 1e-9:.3f} to {stamps.max() * 1e-9:.3f} s"
