"""How far a measured pose may lie from the truth: tracker noise and the robot's repeatability.

A pose is the mean of `count` readings, taken after one move. Its covariance in the tracker's frame
is

    C = (s_r^2 b b^T + s_t^2 (1 - b b^T)) / count + s_q^2 J J^T

with b the beam, s_r and s_t one reading's noise along and across it, J = dy/dq and s_q where a
joint comes to rest. Averaging takes the first part down, not the second: it is one draw a move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Poses
from delta_calibration.estimation.positive import solved
from delta_calibration.robot import Robot, Tracker

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# degrees of freedom from which a spread is measured rather than taken from the robot's file
_ENOUGH = 20
_GROSS = 6.0  # standard deviations beyond which a repeat was disturbed
_CHI3_MEDIAN = 1.538172  # median of the norm of three standard normal numbers
_STEP = 0.05  # of log s_q, over which the bend of its likelihood is taken
_ALIKE = 1e-7  # singular value over the largest, below which conditions act alike
_FEWEST_DEGREES = 1e-3  # of a repeatability that the tracker's noise hides
_LEAST, _MOST = 1e-7, 1e-3  # [rad of a Delta] between which the repeatability is searched


@dataclass(frozen=True)
class Noise:
    """One reading's and one move's standard deviations, and where they come from."""

    radial_scale: float  # measured noise along the beam over the robot file's
    transverse_scale: float
    repeatability: float  # [rad] of each joint
    floor: float  # [m] root mean square 3-D distance of a measured pose from its place's mean
    degrees: int  # of freedom in `floor`; 0 where it is computed, not measured
    measured: bool  # whether repeats were enough to measure it
    freedom: float = np.inf  # degrees of freedom of the repeatability; inf: as filed

    def reading(self, point: Array, tracker: Tracker) -> Array:
        """Covariance of one reading at each point, (n, 3, 3) [m^2]."""
        distance = np.linalg.norm(point, axis=1)
        beam = point / distance[:, None]
        along, across = tracker.sigmas(distance)
        radial = (self.radial_scale * along) ** 2
        transverse = (self.transverse_scale * across) ** 2
        outer = beam[:, :, None] * beam[:, None, :]
        across_all = transverse[:, None, None] * np.eye(3)
        return np.asarray(across_all + (radial - transverse)[:, None, None] * outer)

    def covariance(self, poses: Poses, slope: Array, tracker: Tracker) -> Array:
        """Covariance of each measured pose, (n, 3, 3) [m^2]; `slope` is dy/dq, (n, 3, m)."""
        readings = self.reading(poses.point, tracker) / poses.count[:, None, None]
        return readings + self.repeatability**2 * slope @ np.swapaxes(slope, 1, 2)


def estimate_noise(poses: Poses, slope: Array, robot: Robot) -> Noise:
    """Noise from the scatter within still moments and between repeats; else the robot file's.

    Repeats are compared at the same joint angles: what the encoders saw of a rest error is known
    to the fit, and no noise.

    Args:
        poses: the measured poses.
        slope: dy/dq of the nominal robot at each pose, (n, 3, m) [m/rad], in the tracker's frame.
        robot: the file's tracker noise and repeatability.
    """
    radial, transverse = _reading_scales(poses, robot.tracker)
    seen, _ = _deviations(poses.joint, poses.place)
    poses = replace(poses, point=poses.point - (slope @ seen[..., None])[..., 0])
    filed = Noise(radial, transverse, robot.joints.repeatability, 0.0, 0, False)
    covariance = filed.covariance(poses, slope, robot.tracker)
    poses = _without_gross(poses, covariance)
    course = _course(poses, poses.place, slope)
    visits = _visits(poses.point, poses.place, course)
    if 3 * visits.degrees < 2 * _ENOUGH:  # too few to tell chance from conditions: true repeats
        visits = _visits(poses.point, poses.repeat, course[:, :0])
    degrees = visits.degrees
    if 3 * degrees < _ENOUGH:
        floor = float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean()))
        return replace(filed, floor=floor)
    reading = filed.reading(poses.point, robot.tracker) / poses.count[:, None, None]
    moving = slope @ np.swapaxes(slope, 1, 2)
    bounds = _LEAST * robot.commanded.joint_size, _MOST * robot.commanded.joint_size
    repeatability, freedom = _likeliest(visits, reading, moving, bounds)
    return Noise(radial, transverse, repeatability, visits.floor, degrees, True, freedom)


def whitening(covariance: Array) -> Array:
    """W with W C W^T = 1 for each pose, (n, 3, 3) [1/m]."""
    return np.linalg.inv(np.linalg.cholesky(covariance))


def _reading_scales(poses: Poses, tracker: Tracker) -> tuple[float, float]:
    """Measured over filed standard deviation of a reading, along and across the beam."""
    several = poses.count > 1
    degrees = (poses.count[several] - 1).astype(float)
    if degrees.sum() < _ENOUGH:
        return 1.0, 1.0
    distance = np.linalg.norm(poses.point[several], axis=1)
    beam = poses.point[several] / distance[:, None]
    along, across = tracker.sigmas(distance)
    scatter = poses.scatter[several]
    radial = np.einsum("ni,nij,nj->n", beam, scatter, beam)
    transverse = (np.trace(scatter, axis1=1, axis2=2) - radial) / 2
    share = degrees / degrees.sum()
    scales = np.sqrt(share @ (radial / along**2)), np.sqrt(share @ (transverse / across**2))
    return max(float(scales[0]), 1e-3), max(float(scales[1]), 1e-3)


def _without_gross(poses: Poses, covariance: Array) -> Poses:
    """The poses, those of a repeat that holds a gross error numbered apart, as if never repeated.

    A knocked reflector is no noise: repeats that lie 6 robust standard deviations apart do not
    count.
    """
    deviation, degrees = _deviations(poses.point, poses.repeat)
    if degrees == 0:
        return poses
    size = np.bincount(poses.repeat)[poses.repeat]
    several = size > 1
    distance = np.linalg.norm((whitening(covariance) @ deviation[..., None])[..., 0], axis=1)
    distance[several] /= np.sqrt(1 - 1 / size[several])
    typical = float(np.median(distance[several])) / _CHI3_MEDIAN
    gross = np.isin(poses.repeat, poses.repeat[several & (distance > _GROSS * max(typical, 1.0))])
    apart = np.arange(int(gross.sum()))
    repeat, place = poses.repeat.copy(), poses.place.copy()
    repeat[gross], place[gross] = apart + repeat.max() + 1, apart + place.max() + 1
    return replace(poses, repeat=repeat, place=place)


@dataclass(frozen=True)
class _Visits:
    """Deviations within places, and what of them is no chance."""

    place: Index  # (n,) of each pose
    deviation: Array  # (n, 3) [m] from the place's mean
    course: Array  # (3 n, p) orthonormal: what conditions may do within places

    @property
    def degrees(self) -> int:
        """Degrees of freedom of a pose that are left to chance."""
        size = np.bincount(self.place)
        taken = -(-int(self.course.shape[1]) // 3)
        return max(int((size[size > 0] - 1).sum()) - taken, 0)

    @property
    def floor(self) -> float:
        """Root mean square 3-D distance by chance from a place's mean [m]."""
        flat = self.deviation.reshape(-1)
        left = flat - self.course @ (self.course.T @ flat)
        return float(np.sqrt(left @ left / max(self.degrees, 1)))


def _visits(point: Array, place: Index, course: Array) -> _Visits:
    return _Visits(place, _deviations(point, place)[0], course)


def _course(poses: Poses, place: Index, slope: Array) -> Array:
    """What conditions may do between visits of a place, an orthonormal basis (3 n, p).

    What a warming machine, a drifting tracker, a play or a payload does between two visits of a
    place is no noise. Whatever it is, it moves the platform smoothly: each joint by a cubic in
    time, by the sides it was approached from and by the payload, all of which may change over the
    workspace like a plane.
    """
    clock = 2 * (poses.time - poses.time.min()) / max(float(np.ptp(poses.time)), 1e-9) - 1
    payload = np.nan_to_num(poses.payload)
    condition = np.column_stack([clock, clock**2, clock**3, payload, poses.direction])
    plane = np.column_stack([np.ones(len(poses)), poses.joint])
    course = (condition[:, :, None] * plane[:, None, :]).reshape(len(poses), -1)
    columns = (slope[:, :, None, :] * course[:, None, :, None]).reshape(len(poses), -1)
    within = _deviations(columns, place)[0].reshape(3 * len(poses), -1)
    scale = np.linalg.norm(within, axis=0)
    if not scale.any():
        return within[:, :0]
    basis, value, _ = np.linalg.svd(within[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(basis[:, value > _ALIKE * value[0]])


def _deviations(values: Array, label: Index) -> tuple[Array, int]:
    """Each row (n, k) less its group's mean, and the degrees of freedom (rows over groups)."""
    size, width = np.bincount(label), values.shape[1]
    cell = label[:, None] * width + np.arange(width)
    total = np.bincount(cell.ravel(), values.ravel(), len(size) * width).reshape(-1, width)
    deviation = values - (total / np.maximum(size, 1)[:, None])[label]
    return deviation, int((size[size > 0] - 1).sum())


def turn_noise(turned: Array, repeat: Index, count: Index, resting: Array, stated: float) -> float:
    """Standard deviation of one reading of a turn about each axis [rad].

    Most likely by how repeats differ, beside where the joints come to rest; as the robot's file
    states it where they are too few.

    Args:
        turned: rotation vectors from one of its repeat's to each pose's, (n, 3) [rad], small.
        repeat: which poses repeat each other, (n,).
        count: readings of each pose, (n,).
        resting: covariance of the turns that joints make at rest beside their command, (n, 3, 3).
        stated: by the robot's file [rad].
    """
    visits = _visits(turned, repeat, np.zeros((turned.size, 0)))
    if 3 * visits.degrees < _ENOUGH:
        return stated
    reading = np.eye(3) / count[:, None, None]
    return _likeliest(visits, resting, reading, (_LEAST, _MOST))[0]


def _likeliest(
    visits: _Visits, fixed: Array, growing: Array, bounds: tuple[float, float]
) -> tuple[float, float]:
    """Most likely s of the covariance F + s^2 G, and its degrees of freedom by how sharp it is.

    Gaussian, one draw a move, by the restricted likelihood: places and conditions are fitted
    beside it by the covariance that s gives, and what they take is not counted as small
    (Patterson and Thompson 1971, Biometrika 58, 545-554).

    Args:
        visits: deviations within places.
        fixed: F of each pose, (n, 3, 3).
        growing: G of each pose, (n, 3, 3).
        bounds: between which s is searched.
    """
    from scipy.optimize import minimize_scalar  # slow to load

    several = np.bincount(visits.place)[visits.place] > 1
    _, place = np.unique(visits.place[several], return_inverse=True)
    order = np.argsort(place, kind="stable")
    first = np.flatnonzero(np.diff(place[order], prepend=-1))
    course = visits.course.reshape(len(several), 3, -1)
    columns = np.concatenate([course, visits.deviation[..., None]], axis=2)[several][order]
    least = bounds[0] ** 2  # where F is singular, F + s^2 G is not
    turn, growth = _apart((fixed + least * growing)[several][order], growing[several][order])
    columns, back = turn @ columns, turn.transpose(0, 2, 1)
    width = columns.shape[2]

    def unlikeliness(log_sigma: float) -> float:
        variance = 1.0 + (np.exp(2 * log_sigma) - least) * growth
        rooted = columns / np.sqrt(variance)[..., None]
        places = np.add.reduceat(back / variance[:, None, :] @ turn, first)
        along = np.add.reduceat(back / np.sqrt(variance)[:, None, :] @ rooted, first)
        mean = (whitening(places) @ along).reshape(-1, width)
        rooted = rooted.reshape(-1, width)
        whole = rooted.T @ rooted - mean.T @ mean
        known, beside = whole[:-1, :-1], whole[:-1, -1]
        spread = sum(np.linalg.slogdet(each)[1].sum() for each in (places, known))
        spread += np.log(variance).sum()
        return float(spread + whole[-1, -1] - beside @ solved(known, beside))

    best = minimize_scalar(
        unlikeliness, bounds=np.log(bounds), method="bounded", options={"xatol": 1e-3}
    )
    bend = unlikeliness(best.x - _STEP) - 2 * best.fun + unlikeliness(best.x + _STEP)
    # -2 log L bends four times as much by log s as by log s^2
    return float(np.exp(best.x)), max(bend / _STEP**2 / 4, _FEWEST_DEGREES)


def _apart(fixed: Array, growing: Array) -> tuple[Array, Array]:
    """The common axes of two covariances F and G of each sample, both (n, 3, 3).

    T (n, 3, 3) with T F T^T = 1 and T G T^T diagonal, and that diagonal (n, 3).
    """
    white = whitening(fixed)
    growth, way = np.linalg.eigh(white @ growing @ white.transpose(0, 2, 1))
    return way.transpose(0, 2, 1) @ white, growth
