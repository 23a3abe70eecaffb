"""Repeated visits of a place: their deviations, what conditions may explain, and gross errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Poses

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_GROSS = 6.0  # standard deviations beyond which a repeat is a gross error
_LARGEST = 0.7  # of the largest, above the half by which one of three draws the other two
_FREE = 0.1  # share of a pose's variance that its visits must leave, to tell a gross error
_CHI3_MEDIAN = 1.538172  # median of the norm of three standard normal numbers
_ALIKE = 1e-7  # singular value over the largest, below which columns are linearly dependent


@dataclass(frozen=True)
class Visits:
    """Deviations of poses from their place's mean, and the part that conditions may explain."""

    place: Index  # (n,) of each pose
    deviation: Array  # (n, 3) [m] from the place's mean
    course: Array  # (3 n, p) orthonormal basis of changes with the conditions, see `_course`

    @property
    def degrees(self) -> int:
        """Degrees of freedom of the noise, in poses of three coordinates."""
        size = np.bincount(self.place)
        taken = -(-int(self.course.shape[1]) // 3)
        return max(int((size[size > 0] - 1).sum()) - taken, 0)

    @property
    def floor(self) -> float:
        """Root mean square 3-D distance from a place's mean by noise alone [m]."""
        return float(np.sqrt(np.sum(self.left**2) / max(self.degrees, 1)))

    @property
    def left(self) -> Array:
        """Deviations that the conditions leave unexplained, (n, 3) [m]."""
        flat = self.deviation.reshape(-1)
        return np.asarray(flat - self.course @ (self.course.T @ flat)).reshape(-1, 3)

    @property
    def free(self) -> Array:
        """Share of each pose's variance that `left` holds, the mean of its coordinates, (n,)."""
        size = np.bincount(self.place)[self.place]
        taken = np.sum(self.course.reshape(len(size), -1) ** 2, axis=1) / 3
        return np.asarray(1 - 1 / size - taken)


def visits_of(point: Array, place: Index, course: Array | None = None) -> Visits:
    """Visits of each place by points (n, 3) [m], with the changes of a course if it is given."""
    course = np.zeros((point.size, 0)) if course is None else course
    return Visits(place, deviations(point, place), course)


def visits_by_conditions(poses: Poses, place: Index, slope: Array) -> Visits:
    """Visits of each place, with the changes that the conditions may cause."""
    return visits_of(poses.point, place, _course(poses, place, slope))


def _course(poses: Poses, place: Index, slope: Array) -> Array:
    """Orthonormal basis (3 n, p) of the changes by conditions between visits of a place.

    Changes between two visits by warming, a drifting tracker, backlash or a payload are no noise.
    All of them are modelled as smooth joint errors: a cubic in time, plus terms in the directions
    of approach and in the payload, with coefficients that are linear in the joint coordinates.
    """
    clock = _clock(poses)
    several = np.flatnonzero(np.bincount(place)[place] > 1)
    basis = _changes(poses.take(several), clock[several], place[several], slope[several])
    every = np.zeros((len(poses), 3, basis.shape[1]))
    every[several] = basis.reshape(len(several), *every.shape[1:])
    return every.reshape(3 * len(poses), basis.shape[1])


def _changes(poses: Poses, clock: Array, place: Index, slope: Array) -> Array:
    """`_course` of poses at places that were visited several times."""
    if not len(poses):
        return np.zeros((0, 0))
    plane = np.column_stack([np.ones(len(poses)), poses.joint])
    course = _by_condition(poses, plane, clock)
    columns = (slope[:, :, None, :] * course[:, None, :, None]).reshape(len(poses), -1)
    return _basis(deviations(columns, place).reshape(3 * len(poses), -1))


def plain_course(poses: Poses, place: Index, slope: Array) -> Array:
    """`_course` in plain form: each joint changes with its own direction, time and payload.

    On an arm of many joints a few dozen visits cannot determine the hundreds of coefficients of
    the other form. Here each joint has three, all linear.

    Args:
        poses: the measured poses, (n,).
        place: label of the place of each, (n,).
        slope: derivative of what is compared by the joints, (n, 3, m).
    """
    common = np.column_stack([_clock(poses), np.nan_to_num(poses.payload)])
    joints = np.repeat(common[:, None], slope.shape[2], axis=1)
    condition = np.concatenate([joints, poses.direction[..., None]], axis=2)
    columns = (slope[..., None] * condition[:, None]).reshape(len(poses), -1)
    return _basis(deviations(columns, place).reshape(3 * len(poses), -1))


def _by_condition(poses: Poses, plane: Array, clock: Array | None = None) -> Array:
    """Products of each condition with each column of `plane` (n, p), (n, conditions p)."""
    clock = _clock(poses) if clock is None else clock
    payload = np.nan_to_num(poses.payload)
    condition = np.column_stack([clock, clock**2, clock**3, payload, poses.direction])
    return np.asarray((condition[:, :, None] * plane[:, None, :]).reshape(len(poses), -1))


def _clock(poses: Poses) -> Array:
    """Time of each pose, from -1 to 1, (n,)."""
    past = poses.time - poses.time.min()
    return np.asarray(2 * past / max(float(past.max()), 1e-9) - 1)


def _basis(columns: Array) -> Array:
    """Orthonormal basis of the space of some columns, (3 n, p)."""
    scale = np.linalg.norm(columns, axis=0)
    if not scale.any():
        return columns[:, :0]
    basis, value, _ = np.linalg.svd(columns[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(basis[:, value > _ALIKE * value[0]])


def deviations(values: Array, label: Index) -> Array:
    """Each row (n, k) less its group's mean."""
    size, width = np.bincount(label), values.shape[1]
    cell = label[:, None] * width + np.arange(width)
    total = np.bincount(cell.ravel(), values.ravel(), len(size) * width).reshape(-1, width)
    return np.asarray(values - (total / np.maximum(size, 1)[:, None])[label])


def without_gross_errors(
    label: Index, white: Array, visits: Callable[[Index], Visits], gross_from: float = _GROSS
) -> tuple[Index, NDArray[np.bool_]]:
    """Labels of visits with the gross errors in groups of their own, and where these are.

    The largest are found first, as they draw means and courses, and so deviations of others.
    """
    found = np.zeros(len(label), dtype=bool)
    while (gross := _gross(visits(label), white, gross_from)).any():
        label, found = alone(label, gross), found | gross
    return label, found


def alone(label: Index, rows: NDArray[np.bool_]) -> Index:
    """Labels of groups (n,), with some rows in groups of their own."""
    new = label.copy()
    new[rows] = label.max() + 1 + np.arange(int(rows.sum()))
    return new


def _gross(visits: Visits, white: Array, gross_from: float) -> NDArray[np.bool_]:
    """Largest gross errors among visits, (n,).

    Args:
        visits: of all poses.
        white: whitens the noise of each, (n, 3, 3).
        gross_from: robust standard deviations beyond which a deviation is a gross error.
    """
    free = visits.free
    told = free > _FREE
    if not told.any():
        return told
    distance = np.linalg.norm((white @ visits.left[..., None])[..., 0], axis=1)
    distance = np.where(told, distance / np.sqrt(np.where(told, free, 1.0)), 0.0)
    typical = max(float(np.median(distance[told])) / _CHI3_MEDIAN, 1.0)
    return np.asarray(distance > max(gross_from * typical, _LARGEST * distance.max()))


def without_displacements(visits: Visits, poses: Poses) -> Visits:
    """Visits whose noise excludes displacements by the conditions in any direction.

    A base that sinks or a column that grows moves the reflector as no joint can. Displacements are
    linear in the place.
    """
    mean = poses.point - visits.deviation  # of a place: its noise is not that of a visit
    about = mean - mean.mean(axis=0)
    plane = np.column_stack([np.ones(len(poses)), about / max(float(np.abs(about).max()), 1e-9)])
    moved = _by_condition(poses, plane)[:, None, :, None] * np.eye(3)[:, None, :]
    within = deviations(moved.reshape(len(poses), -1), visits.place)
    within = within.reshape(visits.deviation.size, -1)
    return replace(visits, course=_basis(np.hstack([visits.course, within])))
