"""Measured poses and paths, each sample with its conditions."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data.conditions import SAME_PAYLOAD, Conditions, joined
from delta_calibration.data.motion import Motion, largest_around, motion_of
from delta_calibration.data.readings import Readings, Rejected, match
from delta_calibration.data.still import StillMoments, find_still
from delta_calibration.data.streams import PayloadStream, Session
from delta_calibration.errors import DataError
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SAME_PLACE = 200e-6  # [rad of a Delta] commands this close are the same place
_PAIRS = 6  # least number of pairs of successive stops that show an unrecorded motion
_PAUSE = 0.25  # [s] readings farther apart belong to different paths
_PATH_READINGS, _PATH_LENGTH = 20, 0.02  # [rad of a Delta] of the shortest path used
# a joint speed below this share of the largest within so long [s] before and after is rest
_RESTING, _AROUND = 0.1, 0.5
BLOCK = 2.5e-3  # [rad of a Delta] of travel over which a path is straight to half a micrometre


@dataclass(frozen=True)
class Poses:
    """Poses measured at rest, in the order of time.

    `place` numbers equal commands, `repeat` equal commands reached from the same side with the
    same payload: poses of one `repeat` differ only by noise and by changes with time.
    """

    source: str
    start_ns: int
    time: Array  # (n,) [s] middle of the still moment since start_ns
    joint: Array  # (n, m) [rad] by the encoders
    command: Array  # (n, m) [rad]
    point: Array  # (n, 3) [m] in the tracker's frame
    quaternion: Array | None  # (n, 4)
    count: Index  # (n,) readings averaged
    scatter: Array  # (n, 3, 3) [m^2] of a single reading
    direction: Array  # (n, m) sign of each joint's last motion, 0 if unknown
    travel: Array  # (n, m) [rad] from each joint's last reversal, infinite if unknown
    payload: Array  # (n,) [kg], NaN if unknown
    payload_centre: Array  # (n, 3) [m]
    temperature_parts: tuple[str, ...]
    temperature: Array  # (n, parts) [deg C]
    place: Index  # (n,)
    repeat: Index  # (n,)
    readings: int  # in the session, before anything was set aside
    duration: float  # [s]
    rejected: Rejected
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def unseen_motion(self) -> float:
        """Median distance between successive poses with the same `repeat` number [m].

        Between these no motion to another stop was recorded. If the distance is far above the
        noise, the joints moved in between: the sides of approach are unknown. 0 with fewer than
        six such pairs.
        """
        still = np.flatnonzero(self.repeat[1:] == self.repeat[:-1])
        if len(still) < _PAIRS:
            return 0.0
        apart = np.linalg.norm(self.point[still + 1] - self.point[still], axis=1)
        return float(np.median(apart))

    @property
    def conditions(self) -> Conditions:
        """Conditions of each pose, at rest."""
        still = np.zeros_like(self.joint)
        return Conditions(
            joint=self.joint,
            time=self.time,
            velocity=still,
            acceleration=still,
            direction=self.direction,
            travel=self.travel,
            payload=self.payload,
            payload_centre=self.payload_centre,
            temperature_parts=self.temperature_parts,
            temperature=self.temperature,
            reading=self.point,
            reading_velocity=np.zeros_like(self.point),
            reading_acceleration=np.zeros_like(self.point),
        )

    @property
    def digest(self) -> str:
        """SHA-256 of the measured positions, rounded to 1 nm, without the session's name."""
        return hashlib.sha256(np.round(1e9 * self.point).astype("<i8").tobytes()).hexdigest()

    def take(self, rows: NDArray[np.intp]) -> Poses:
        """Some of the poses; the entries about the whole session are unchanged."""
        each: dict[str, Any] = {
            name: value[rows]
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray) and len(value) == len(self)
        }
        return replace(self, **each)


@dataclass(frozen=True)
class Paths:
    """Readings taken in motion, averaged over 2.5 mrad of travel at most.

    `path` numbers the stretches of uninterrupted motion: the joints' rest error is drawn once a
    move, so that it is a constant offset along a path and not noise.
    """

    conditions: Conditions
    count: Index  # (n,) readings averaged
    path: Index  # (n,)

    def __len__(self) -> int:
        return len(self.path)


@dataclass(frozen=True)
class Survey:
    """All measurements of a session: poses at rest and paths in motion."""

    poses: Poses
    paths: Paths

    @cached_property
    def conditions(self) -> Conditions:
        """Conditions of the poses, then of the paths' readings."""
        return joined(self.poses.conditions, self.paths.conditions)


def collect(session: Session, joint_names: Sequence[str], joint_size: float = 1.0) -> Poses:
    """Return the measured poses of a session with their conditions.

    Args:
        session: the recorded streams.
        joint_names: of the robot, in the order of its joint vectors.
        joint_size: displacement, in the joints' unit, that corresponds to 1 rad of a Delta.

    Raises:
        RecordingError: streams missing, or joints of another robot.
        DataError: no overlap in time, or no pose at rest.
    """
    return _poses(session, *_seen(session, joint_names, joint_size), joint_size)


def survey(session: Session, joint_names: Sequence[str], joint_size: float = 1.0) -> Survey:
    """Return the measured poses and paths of a session with their conditions.

    Args:
        session: the recorded streams.
        joint_names: of the robot, in the order of its joint vectors.
        joint_size: displacement, in the joints' unit, that corresponds to 1 rad of a Delta.

    Raises:
        RecordingError: streams missing, or joints of another robot.
        DataError: no overlap in time, or no pose at rest.
    """
    seen = _seen(session, joint_names, joint_size)
    return Survey(_poses(session, *seen, joint_size), _paths(session, *seen, joint_size))


def _seen(
    session: Session, joint_names: Sequence[str], joint_size: float
) -> tuple[Readings, StillMoments, Motion]:
    readings = match(session, joint_names, joint_size)
    moments, readings = find_still(readings, joint_size)
    return readings, moments, _motion(session, joint_names, readings.start_ns, joint_size)


def _poses(
    session: Session,
    readings: Readings,
    moments: StillMoments,
    motion: Motion,
    joint_size: float,
) -> Poses:
    middle = (moments.begin + moments.end) / 2
    stamps = _stamps(readings, middle)
    payload, centre = _payload(session.payload, stamps)
    direction, travel = motion.sides(moments.begin)
    place = _clusters(moments.command, _SAME_PLACE * joint_size)
    held = _clusters(np.nan_to_num(payload, nan=-1.0)[:, None], SAME_PAYLOAD)
    _, repeat = np.unique(
        np.column_stack([place, held, direction.astype(np.int64)]), axis=0, return_inverse=True
    )
    tracker = session.tracker
    return Poses(
        source=session.source,
        start_ns=readings.start_ns,
        time=middle,
        joint=moments.joint,
        command=moments.command,
        point=moments.point,
        quaternion=moments.quaternion,
        count=moments.count,
        scatter=moments.scatter,
        direction=direction,
        travel=travel,
        payload=payload,
        payload_centre=centre,
        temperature_parts=tuple(t.part for t in session.temperature),
        temperature=_temperature(session, stamps),
        place=place,
        repeat=repeat.reshape(-1).astype(np.int64),
        readings=0 if tracker is None else len(tracker.stamp_ns),
        duration=float(readings.time[-1] - readings.time[0]),
        rejected=readings.rejected,
        notes=readings.notes,
    )


def _paths(
    session: Session,
    readings: Readings,
    moments: StillMoments,
    motion: Motion,
    joint_size: float,
) -> Paths:
    block, path = _blocks(readings, moments, motion, joint_size)
    used = block >= 0
    label, first, number, count = np.unique(
        block[used], return_index=True, return_inverse=True, return_counts=True
    )

    def mean(values: Array) -> Array:
        total = np.zeros((len(label), *values.shape[1:]))
        np.add.at(total, number, values[used])
        return np.asarray(total / count.reshape((-1,) + (1,) * (values.ndim - 1)))

    time = mean(readings.time)
    stamps = _stamps(readings, time)
    payload, centre = _payload(session.payload, stamps)
    velocity, acceleration, direction, travel = motion.at(time)
    conditions = Conditions(
        joint=mean(readings.joint),
        time=time,
        velocity=velocity,
        acceleration=acceleration,
        direction=direction,
        travel=travel,
        payload=payload,
        payload_centre=centre,
        temperature_parts=tuple(t.part for t in session.temperature),
        temperature=_temperature(session, stamps),
        reading=mean(readings.point),
        reading_velocity=np.full((len(label), 3), np.nan),
        reading_acceleration=np.full((len(label), 3), np.nan),
    )
    return Paths(conditions, count.astype(np.int64), path[used][first])


def _blocks(
    readings: Readings, moments: StillMoments, motion: Motion, joint_size: float
) -> tuple[Index, Index]:
    """Block and path that each reading belongs to, (n,) each; -1 for readings of no path.

    One motion is one path: after a rest, however short, another path begins, with another rest
    error of the joints.
    """
    time, joint = readings.time, readings.joint
    after = np.searchsorted(moments.begin, time, side="right") - 1
    resting = (after >= 0) & (time <= moments.end[np.clip(after, 0, None)])
    velocity, _, direction, _ = motion.at(time)
    speed = np.linalg.norm(velocity, axis=1)
    period = float(np.median(np.diff(time))) if len(time) > 1 else _AROUND
    resting |= speed < _RESTING * largest_around(speed, int(_AROUND / period))
    broken = np.r_[True, (np.diff(time) > _PAUSE) | (np.diff(resting.astype(int)) != 0)]
    path = np.cumsum(broken) - 1
    gone = np.abs(np.diff(joint, axis=0, prepend=joint[:1])).max(axis=1) / joint_size
    gone[broken] = 0.0
    size = np.bincount(path)
    length = np.bincount(path, weights=gone)
    good = (size[path] >= _PATH_READINGS) & (length[path] >= _PATH_LENGTH) & ~resting
    # blocks of equal travel within each path, none across a joint's reversal
    along = np.cumsum(gone)
    along -= along[np.flatnonzero(broken)][path]
    step = np.floor(along / BLOCK).astype(np.int64)
    turned = (np.diff(direction, axis=0) != 0).any(axis=1)
    block = np.cumsum(np.r_[True, (np.diff(step) != 0) | turned | broken[1:]]) - 1
    return np.where(good, block, -1), path.astype(np.int64)


def _stamps(readings: Readings, time: Array) -> NDArray[np.int64]:
    return readings.start_ns + np.round(time * 1e9).astype(np.int64)


def _motion(session: Session, names: Sequence[str], start_ns: int, joint_size: float) -> Motion:
    """Motion of the commanded joints, which have no noise, or else of the measured ones."""
    stream = session.command or session.states
    if stream is None:
        return motion_of(np.zeros(1), np.zeros((1, len(names))))
    columns = [stream.names.index(name) for name in names]
    stamps, order = np.unique(stream.stamp_ns, return_index=True)
    time = np.asarray((stamps - start_ns) * 1e-9, dtype=np.float64)
    return motion_of(time, stream.position[order][:, columns], joint_size)


def require_poses(poses: Poses, least: int) -> None:
    """Refuse a session with too few different places.

    Raises:
        DataError: names the number of places found and needed.
    """
    places = len(np.unique(poses.place))
    if places < least:
        raise DataError(
            f"{poses.source}: {places} different poses at rest, "
            f"{least} or more are needed to fit a model"
        )


def _payload(stream: PayloadStream | None, stamps: NDArray[np.int64]) -> tuple[Array, Array]:
    """Mass and centre of the payload at each stamp; NaN before the first message."""
    mass, centre = np.full(len(stamps), np.nan), np.full((len(stamps), 3), np.nan)
    if stream is None or len(stream.stamp_ns) == 0:
        return mass, centre
    order = np.argsort(stream.stamp_ns, kind="stable")
    last = np.searchsorted(stream.stamp_ns[order], stamps, side="right") - 1
    known = last >= 0
    mass[known] = stream.mass[order][last[known]]
    centre[known] = stream.centre[order][last[known]]
    return mass, centre


def _temperature(session: Session, stamps: NDArray[np.int64]) -> Array:
    """Each sensor's temperature at the stamps, (n, parts)."""
    columns = []
    for stream in session.temperature:
        order = np.argsort(stream.stamp_ns, kind="stable")
        first = stream.stamp_ns[order[0]]
        own = (stream.stamp_ns[order] - first) * 1e-9
        columns.append(np.interp((stamps - first) * 1e-9, own, stream.celsius[order]))
    return np.column_stack(columns) if columns else np.zeros((len(stamps), 0))


def _clusters(values: Array, width: float) -> Index:
    """Group number of each row, (n,); rows within `width` of the group's first are one group."""
    label = np.full(len(values), -1, dtype=np.int64)
    number = 0
    for row in range(len(values)):
        if label[row] < 0:
            close = (np.abs(values - values[row]).max(axis=1) <= width) & (label < 0)
            label[close] = number
            number += 1
    return label
