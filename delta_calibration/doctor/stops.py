"""Finds the stops of a session whatever the units of its streams: one message per stop.

A fit finds the periods at rest by thresholds in radians and metres. These fail on a session in
wrong units, so here a joint is at rest if it moves by less than a share of its own range.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import JointStream, Session, TrackerStream, repeats
from delta_calibration.doctor.change import joint_streams, joints_of

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

SPARSE = 0.5  # [s] readings farther apart are one message per stop
_HOLD = 1e-6, 3e-4  # smallest and largest threshold of rest, as a share of the joint's range
_SIGMAS = 8.0  # threshold of rest in standard deviations of the noise
_QUIET = 0.2, 0.2533  # share of the steps that are noise, and that quantile of |N(0, 1)|
_FEWEST, _SHORTEST = 4, 0.12  # least number of readings and duration [s] of a stop
_PAUSE = 1.0  # [s] a longer gap ends a stop
_GAP = 0.5  # [s] across a longer gap joints are known only if they were at rest
_PITCH = 0.4  # of the interval of sparse readings, within which joints belong to a reading
_UNSTEADY = 20.0  # times the typical scatter; a stop that scatters more is left out
LEAST = 6  # stops; with fewer a session cannot be examined


def stops_of(session: Session) -> Session | None:
    """The stops of a session with joints in order (`in_order`); None if there are too few.

    All streams of the result have the same stamps: the middle of each stop. Readings that repeat a
    frozen value are left out.
    """
    tracker, names = session.tracker, joint_streams(session)
    if tracker is None or not names:
        return None
    tracker = _rows(tracker, ~repeats(tracker.position))
    if len(tracker.stamp_ns) < LEAST:
        return None
    joints = {name: joints_of(session, name) for name in names}
    pitch = float(np.median(np.diff(tracker.stamp_ns))) * 1e-9
    sparse = pitch > SPARSE
    reach = _PITCH * pitch if sparse else _GAP
    values, known = {}, np.ones(len(tracker.stamp_ns), dtype=bool)
    for name, stream in joints.items():
        assert stream is not None
        values[name], there = _at(stream, tracker.stamp_ns, reach)
        known &= there
    if known.sum() < LEAST:
        return None
    stamps = tracker.stamp_ns[known]
    values = {name: value[known] for name, value in values.items()}
    kept = _rows(tracker, known)
    if sparse:
        groups = [np.array([row]) for row in range(len(stamps))]
    else:
        groups = _at_rest(stamps, values, kept.position)
    if len(groups) < LEAST:
        return None
    return _session(session, stamps, values, kept, groups)


def thinned(stops: Session, most: int) -> Session:
    """At most `most` stops, spread evenly over the session."""
    tracker = stops.tracker
    if tracker is None or len(tracker.stamp_ns) <= most:
        return stops
    keep = np.linspace(0, len(tracker.stamp_ns) - 1, most).astype(int)
    return taken(stops, keep)


def taken(stops: Session, keep: NDArray[np.intp]) -> Session:
    """The stops of the given rows."""
    return replace(
        stops,
        command=_joint_rows(stops.command, keep),
        states=_joint_rows(stops.states, keep),
        tracker=None if stops.tracker is None else _rows(stops.tracker, keep),
    )


def _joint_rows(stream: JointStream | None, keep: NDArray[np.intp]) -> JointStream | None:
    if stream is None:
        return None
    return JointStream(stream.stamp_ns[keep], stream.names, stream.position[keep])


def _rows(stream: TrackerStream, keep: NDArray[np.bool_] | NDArray[np.intp]) -> TrackerStream:
    turned = None if stream.quaternion is None else stream.quaternion[keep]
    return TrackerStream(stream.stamp_ns[keep], stream.position[keep], turned)


def _at(stream: JointStream, stamps: Stamps, reach: float) -> tuple[Array, NDArray[np.bool_]]:
    """Joints interpolated at stamps, (n, m), and the mask of stamps at which they are known.

    Between two messages more than `reach` [s] apart the nearer one is used, if within `reach`.
    """
    own, position = stream.stamp_ns, stream.position
    if len(own) == 1:
        near = np.abs(stamps - own[0]) * 1e-9 <= reach
        return np.repeat(position, len(stamps), axis=0), near
    after = np.searchsorted(own, stamps).clip(1, len(own) - 1)
    before = after - 1
    gap = (own[after] - own[before]) * 1e-9
    share = np.clip((stamps - own[before]) * 1e-9 / gap, 0.0, 1.0)
    nearer = np.where(share > 0.5, after, before)
    close = np.abs(own[nearer] - stamps) * 1e-9 <= reach
    inside = (own[before] <= stamps) & (stamps <= own[after])
    moved = np.abs(position[after] - position[before]).max(axis=1)
    held = moved <= _HOLD[1] * max(float(np.ptp(position, axis=0).max()), 1e-12)
    smooth = inside & ((gap <= reach) | held)
    between = position[before] + share[:, None] * (position[after] - position[before])
    return np.where(smooth[:, None], between, position[nearer]), smooth | close


def _at_rest(stamps: Stamps, values: dict[str, Array], point: Array) -> list[NDArray[np.intp]]:
    """Rows of each stop: its later half, in which the platform has settled."""
    joint = np.concatenate(list(values.values()), axis=1)
    time = (stamps - stamps[0]) * 1e-9
    hold = _hold(joint)
    cut = (np.abs(np.diff(joint, axis=0)) > hold).any(axis=1) | (np.diff(time) > _PAUSE)
    edges = np.r_[0, np.flatnonzero(cut) + 1, len(time)]
    groups, scatter = [], []
    for begin, end in pairwise(edges):
        long = end - begin >= _FEWEST and time[end - 1] - time[begin] >= _SHORTEST
        if long and (np.ptp(joint[begin:end], axis=0) <= 2 * hold).all():
            rows = np.arange(begin + (end - begin) // 2, end)
            groups.append(rows)
            scatter.append(np.linalg.norm(point[rows] - np.median(point[rows], 0), axis=1).mean())
    if not groups:
        return []
    usual = _UNSTEADY * float(np.median(scatter)) + 1e-12
    return [rows for rows, wide in zip(groups, scatter, strict=True) if wide <= usual]


def _hold(joint: Array) -> Array:
    """Threshold of rest: the largest step of each joint between two readings, (m,)."""
    share, quantile = _QUIET
    steps = np.abs(np.diff(joint, axis=0))
    sigma = np.quantile(steps, share, axis=0) / quantile / np.sqrt(2)
    span = np.maximum(np.quantile(joint, 0.98, axis=0) - np.quantile(joint, 0.02, axis=0), 1e-12)
    return np.asarray(np.clip(_SIGMAS * sigma, _HOLD[0] * span, _HOLD[1] * span))


def _session(
    session: Session,
    stamps: Stamps,
    values: dict[str, Array],
    tracker: TrackerStream,
    groups: list[NDArray[np.intp]],
) -> Session:
    middle = np.array([stamps[rows[len(rows) // 2]] for rows in groups])
    point = np.array([np.median(tracker.position[rows], axis=0) for rows in groups])
    last = np.array([rows[-1] for rows in groups])
    turned = None if tracker.quaternion is None else tracker.quaternion[last]

    def joints(stream: JointStream | None, name: str) -> JointStream | None:
        if stream is None:
            return None
        mean = np.array([values[name][rows].mean(axis=0) for rows in groups])
        return JointStream(middle, stream.names, mean)

    return replace(
        session,
        command=joints(session.command, "joint_command"),
        states=joints(session.states, "joint_states"),
        tracker=TrackerStream(middle, point, turned),
        temperature=(),
        payload=None,
    )
