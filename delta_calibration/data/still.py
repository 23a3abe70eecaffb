"""Detection of still moments: the joints are held and the platform has come to rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data.readings import Readings
from delta_calibration.errors import DataError

Array = NDArray[np.float64]

# limits in radians of a Delta, to be multiplied by the mechanism's joint size
_HOLD = 20e-6  # [rad] joints that stay within this of a moment's first value are held ...
_COMMANDED = 1e-6  # [rad] the same limit for commanded angles, which have no noise
_HOLD_SIGMAS = 8.0  # ... or within so many of the encoders' own standard deviations, ...
_HOLD_MOST = 200e-6  # [rad] ... but never beyond: steady motion would look like noise
_QUIET = 0.2, 0.2533  # quantile of the steps used to estimate noise, and of |N(0, 1)|
_BREAK = 1.0  # [s] a pause in the readings longer than this ends a moment
_LONG_ENOUGH = 0.15  # [s] least duration of a moment in a stream; less may be slow motion
_ENOUGH = 5  # least readings of a moment in a stream
_SPARSE = 0.5  # [s] median interval of readings above which a session has one message a pose
_OUTLIER = 6.0  # standard deviations from the moment's rest position
_SCATTER_FLOOR = 1e-6  # [m] so that a few equal readings do not make the next one an outlier
_PER_MEDIAN = 0.8493  # standard deviation over median distance, noise across the beam (Rayleigh)


@dataclass(frozen=True)
class StillMoments:
    """Measurements while the platform stood still, averaged over each moment."""

    begin: Array  # (n,) [s]
    end: Array  # (n,) [s]
    joint: Array  # (n, m) [rad]
    command: Array  # (n, m) [rad]; by the encoders if unknown
    point: Array  # (n, 3) [m] in the tracker's frame
    quaternion: Array | None  # (n, 4)
    count: NDArray[np.int64]  # (n,) readings averaged
    # (n, 3, 3) [m^2] covariance of a single reading in the moment, NaN if there is only one
    scatter: Array


def find_still(readings: Readings, joint_size: float = 1.0) -> tuple[StillMoments, Readings]:
    """Cut the readings into still moments and average each.

    A new moment begins when a joint leaves its value at the start of the moment, or after a pause
    in the readings. In a stream, a moment must last 0.15 s and hold 5 readings; if a session has
    one message a pose, each message is a moment. Readings farther than 6 robust standard
    deviations from the median of their moment's later half are set aside: as settling at the
    start of the moment, as outliers elsewhere.

    Args:
        readings: of the whole session.
        joint_size: displacement, in the joints' unit, that corresponds to 1 rad of a Delta.

    Returns:
        The moments, and the readings with the rejected ones counted.

    Raises:
        DataError: no pose at rest in the session.
    """
    label = _moments(readings, joint_size)
    long_enough = _accepted(readings, label)
    if not long_enough.any():
        frozen = readings.rejected.frozen
        also = f"; {frozen} were set aside as frozen" if frozen else ""
        raise DataError(f"no pose at rest: every reading was taken in motion{also}")
    outlier, settling = _set_aside(readings, label, long_enough)
    kept = long_enough[label] & ~outlier & ~settling
    rejected = replace(readings.rejected, outlier=int(outlier.sum()), settling=int(settling.sum()))
    return _average(readings.take(kept), label[kept]), replace(readings, rejected=rejected)


def _moments(readings: Readings, joint_size: float) -> NDArray[np.intp]:
    """Number of the held interval that each reading lies in, (n,), counted from 0."""
    joint, time = readings.joint, readings.time
    steps, commanded = np.abs(np.diff(joint, axis=0)), np.diff(readings.gone, axis=0)
    hold = _hold(steps, _HOLD, joint_size)
    moved = (steps > hold) | (commanded > _hold(commanded, _COMMANDED, joint_size))
    cut = np.r_[True, moved.any(axis=1) | (np.diff(time) > _BREAK)]
    edges = np.append(np.flatnonzero(cut), len(time))
    # A slow sweep moves less than `hold` a step: cut again wherever it is farther than that from
    # its start.
    for begin, end in pairwise(edges):
        while end - begin > 1:
            left = (np.abs(joint[begin:end] - joint[begin]) > hold).any(axis=1)
            if not left.any():
                break
            begin += int(np.argmax(left))
            cut[begin] = True
    return np.cumsum(cut) - 1


def _hold(steps: Array, least: float, joint_size: float) -> Array:
    """Largest change of each joint that counts as held, (m,) [rad], by the noise of the angles."""
    if len(steps) == 0:
        return np.full(steps.shape[1], least * joint_size)
    share, quantile = _QUIET
    known = np.nan_to_num(steps)  # NaN where no command was near
    sigma = np.quantile(known, share, axis=0) / quantile / np.sqrt(2)
    bounds = least * joint_size, _HOLD_MOST * joint_size
    return np.asarray(np.clip(_HOLD_SIGMAS * sigma, *bounds))


def _accepted(readings: Readings, label: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mask of the moments that are poses, (moments,)."""
    count = np.bincount(label)
    begin = np.full(len(count), np.inf)
    end = np.full(len(count), -np.inf)
    np.minimum.at(begin, label, readings.time)
    np.maximum.at(end, label, readings.time)
    intervals = np.diff(readings.time)
    if len(intervals) == 0 or np.median(intervals) > _SPARSE:
        return np.ones(len(count), dtype=bool)
    return np.asarray((count >= _ENOUGH) & (end - begin >= _LONG_ENOUGH))


def _set_aside(
    readings: Readings, label: NDArray[np.intp], accepted: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks (n,) of outliers and of readings before the platform had settled."""
    outlier = np.zeros(len(label), dtype=bool)
    settling = np.zeros(len(label), dtype=bool)
    moments = np.split(np.arange(len(label)), np.flatnonzero(np.diff(label)) + 1)
    pairs = zip(moments, accepted, strict=True)
    moments = [rows for rows, good in pairs if good and len(rows) >= _ENOUGH]
    if not moments:
        return outlier, settling
    distance = [_from_rest(readings.point[rows]) for rows in moments]
    typical = _PER_MEDIAN * np.median(np.concatenate([d[len(d) // 2 :] for d in distance]))
    limit = _OUTLIER * max(typical, _SCATTER_FLOOR)
    for rows, d in zip(moments, distance, strict=True):
        leading = np.cumsum(d <= limit) == 0
        settling[rows] = (d > limit) & leading
        outlier[rows] = (d > limit) & ~leading
    return outlier, settling


def _from_rest(point: Array) -> Array:
    """Distance of each reading from the moment's rest position, the median of its later half."""
    rest = np.median(point[len(point) // 2 :], axis=0)
    return np.asarray(np.linalg.norm(point - rest, axis=1))


def _average(readings: Readings, label: NDArray[np.intp]) -> StillMoments:
    """Average the readings of each moment."""
    _, first, number, count = np.unique(
        label, return_index=True, return_inverse=True, return_counts=True
    )

    def mean(values: Array) -> Array:
        total = np.zeros((len(count), *values.shape[1:]))
        np.add.at(total, number, values)
        return total / count.reshape((-1,) + (1,) * (values.ndim - 1))

    point = mean(readings.point)
    deviation = readings.point - point[number]
    spread = mean(deviation[:, :, None] * deviation[:, None, :])
    with np.errstate(divide="ignore", invalid="ignore"):
        scatter = spread * (count / (count - 1.0))[:, None, None]
    quaternion = None
    if readings.quaternion is not None:
        reference = readings.quaternion[first][number]
        same_side = np.sign(np.sum(readings.quaternion * reference, axis=1))
        quaternion = mean(readings.quaternion * np.where(same_side < 0, -1.0, 1.0)[:, None])
        quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    last = np.append(first[1:], len(label)) - 1
    joint = mean(readings.joint)
    known = np.isfinite(readings.command)
    with np.errstate(invalid="ignore"):
        command = mean(np.where(known, readings.command, 0.0)) / mean(known.astype(float))
    return StillMoments(
        begin=readings.time[first],
        end=readings.time[last],
        joint=joint,
        command=np.where(np.isfinite(command), command, joint),
        point=point,
        quaternion=quaternion,
        count=count.astype(np.int64),
        scatter=scatter,
    )
