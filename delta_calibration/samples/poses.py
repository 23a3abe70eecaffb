"""Measured poses: what identification works on, each with the conditions it was measured under."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.samples.readings import Readings, Rejected, match
from delta_calibration.samples.still import StillMoments, find_still
from delta_calibration.samples.streams import JointStream, PayloadStream, Session

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_APPROACH = 200e-6  # [rad] a joint that was this far from the pose has moved into it
_SAME_PLACE = 200e-6  # [rad] commands this close are the same place
_SAME_PAYLOAD = 1e-3  # [kg]


@dataclass(frozen=True)
class Poses:
    """Poses measured at rest, in the order of time.

    `place` numbers equal commands, `repeat` equal commands reached from the same side with the
    same payload: poses of one `repeat` differ by noise and by what changes with time only.
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
    direction: Array  # (n, m) sign of each joint's last motion, 0 where not known
    payload: Array  # (n,) [kg], NaN where not known
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

    def take(self, rows: NDArray[np.intp]) -> Poses:
        """Some of the poses; what is said of the session as a whole stays."""
        each: dict[str, Any] = {
            name: value[rows]
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray) and len(value) == len(self)
        }
        return replace(self, **each)


def collect(session: Session, joint_names: Sequence[str]) -> Poses:
    """Measured poses of a session with their conditions.

    Raises:
        RecordingError: streams missing, or joints of another robot.
        DataError: no overlap in time, nothing still.
    """
    readings = match(session, joint_names)
    moments, readings = find_still(readings)
    middle = (moments.begin + moments.end) / 2
    stamps = readings.start_ns + np.round(middle * 1e9).astype(np.int64)
    payload, centre = _payload(session.payload, stamps)
    direction = _direction(session.states or session.command, joint_names, readings, moments)
    place = _clusters(moments.command, _SAME_PLACE)
    held = _clusters(np.nan_to_num(payload, nan=-1.0)[:, None], _SAME_PAYLOAD)
    _, repeat = np.unique(
        np.column_stack([place, held, direction.astype(np.int64)]), axis=0, return_inverse=True
    )
    tracker = session.tracker
    total = 0 if tracker is None else len(tracker.stamp_ns)
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
        payload=payload,
        payload_centre=centre,
        temperature_parts=tuple(t.part for t in session.temperature),
        temperature=_temperature(session, stamps),
        place=place,
        repeat=repeat.reshape(-1).astype(np.int64),
        readings=total,
        duration=float(readings.time[-1] - readings.time[0]),
        rejected=readings.rejected,
        notes=readings.notes,
    )


def require_poses(poses: Poses, least: int) -> None:
    """Refuse a session with too few different places.

    Raises:
        DataError: names how many there are and how many are needed.
    """
    places = len(np.unique(poses.place))
    if places < least:
        raise DataError(
            f"{poses.source}: {places} different poses at rest, "
            f"{least} or more are needed to fit a model"
        )


def _direction(
    stream: JointStream | None, names: Sequence[str], readings: Readings, moments: StillMoments
) -> Array:
    """Sign of the last motion of each joint before each moment, (n, m)."""
    signs = np.zeros_like(moments.joint)
    if stream is None:
        return signs
    columns = [stream.names.index(name) for name in names]
    order = np.argsort(stream.stamp_ns, kind="stable")
    time = (stream.stamp_ns[order] - readings.start_ns) * 1e-9
    angle = stream.position[order][:, columns]
    ends = np.searchsorted(time, moments.begin, side="right")
    starts = np.concatenate([[0], ends[:-1]]) if len(ends) else ends
    for row, (start, end) in enumerate(zip(starts, ends, strict=True)):
        past = angle[start:end] - moments.joint[row]
        for joint in range(past.shape[1]):
            away = np.flatnonzero(np.abs(past[:, joint]) > _APPROACH)
            if away.size:
                signs[row, joint] = -np.sign(past[away[-1], joint])
    return signs


def _payload(stream: PayloadStream | None, stamps: NDArray[np.int64]) -> tuple[Array, Array]:
    """Mass and centre that held at each stamp; NaN before the first message."""
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
        own = (stream.stamp_ns[order] - stamps[0]) * 1e-9
        columns.append(np.interp((stamps - stamps[0]) * 1e-9, own, stream.celsius[order]))
    return np.column_stack(columns) if columns else np.zeros((len(stamps), 0))


def _clusters(values: Array, width: float) -> Index:
    """Number of the group of (nearly) equal rows that each row belongs to, (n,)."""
    label = np.full(len(values), -1, dtype=np.int64)
    number = 0
    for row in range(len(values)):
        if label[row] < 0:
            close = (np.abs(values - values[row]).max(axis=1) <= width) & (label < 0)
            label[close] = number
            number += 1
    return label
