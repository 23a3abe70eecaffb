"""Noise of a measured pose: that of the tracker and the robot's repeatability.

A pose is the mean of `count` readings, taken after one move. Its covariance in the tracker's frame
is

    C = (s_r^2 b b^T + s_t^2 (1 - b b^T)) / count + s_q^2 J J^T

with b the beam direction, s_r and s_t the noise of one reading along and across it, J = dy/dq and
s_q the repeatability of a joint. Averaging reduces the first part only: a rest error is drawn once
a move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from delta_calibration.data import Poses
from delta_calibration.errors import DataError
from delta_calibration.estimation.positive import solved
from delta_calibration.robot import Robot, Tracker

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# degrees of freedom from which a standard deviation is estimated, not taken from the robot file
_ENOUGH = 20
_GROSS = 6.0  # standard deviations beyond which a repeat is a gross error
_LEFT_FAR = 12.0  # the same of what conditions leave: from here on a fit sets a pose aside
_FAR = 20.0  # the same where causes have a part in the deviations, a few times their median
_LARGEST = 0.7  # of the largest, above the half by which one of three draws the other two
_FREE = 0.1  # share of a pose's variance that its visits must leave, to tell a gross error
_CHI3_MEDIAN = 1.538172  # median of the norm of three standard normal numbers
_STEP = 0.05  # step of log s_q in the second difference of its likelihood
_ALIKE = 1e-7  # singular value over the largest, below which columns are linearly dependent
_FEWEST_DEGREES = 1e-3  # of freedom, for a repeatability that is hidden by the tracker's noise
_AS_FILED = 1.0, 1.0  # scales of the tracker's noise
# scale at which it is first tried whether the tracker's noise is larger than filed, largest scale,
# and decrease of -2 ln of the likelihood from which the filed noise is refuted (p = 0.001)
_SLIGHTLY, _LOUDEST, _REFUTED = 1.2, 100.0, 10.8
_FACTORS = 0.1, 100.0  # of the filed noise of tracker and joints, where few visits tell only one
_LEAST, _MOST = 1e-7, 1e-3  # [rad of a Delta] between which the repeatability is searched


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one reading and of one move, and their origin."""

    radial_scale: float  # estimated over filed noise along the beam
    transverse_scale: float  # likewise across the beam
    repeatability: float  # [rad] of each joint
    floor: float  # [m] root mean square 3-D distance of a measured pose from its place's mean
    degrees: int  # of freedom in `floor`; 0 if it is computed, not measured
    measured: bool  # whether there were enough repeats to measure it
    freedom: float = np.inf  # degrees of freedom of the repeatability; inf: as filed
    in_proportion: bool = False  # one factor for tracker and joints: visits did not part the two
    raised: float = 1.0  # factor on the filed noise by residuals, see `louder`
    most: float = np.inf  # largest factor on the filed noise that a few visits allow

    def louder(self, factor: float) -> Noise:
        """The noise times a factor: residuals without order exceed noise that was never measured.

        It is not reduced below that of the robot file.

        Args:
            factor: root mean square of the residuals over that of this noise.
        """
        factor = max(factor, 1.0 / self.raised)
        return replace(
            self,
            radial_scale=factor * self.radial_scale,
            transverse_scale=factor * self.transverse_scale,
            repeatability=factor * self.repeatability,
            floor=factor * self.floor,
            raised=max(1.0, factor * self.raised),
        )

    def reading(self, point: Array, tracker: Tracker) -> Array:
        """Covariance of one reading at each point, (n, 3, 3) [m^2]."""
        distance, beam = _beams(point)
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


def _beams(point: Array) -> tuple[Array, Array]:
    """Distance of each pose's point (n, 3) from the device, (n,) [m], and direction, (n, 3).

    Raises:
        DataError: a point at the device's own origin, which lies in no direction.
    """
    distance = np.linalg.norm(point, axis=1)
    if not distance.all():
        raise DataError(
            f"pose {np.argmin(distance) + 1}: the reading is (0, 0, 0), the place of the "
            "measuring device itself; remove it if nothing was measured, or give all readings in "
            "a frame whose origin is the device"
        )
    return distance, point / distance[:, None]


def estimate_noise(poses: Poses, slope: Array, robot: Robot) -> Noise:
    """Estimate noise from the scatter in still moments and of repeats; else take the file's.

    Repeats are compared at the same joint angles: the part of a rest error that the encoders show
    is known to the fit and is no noise.

    Args:
        poses: the measured poses.
        slope: dy/dq of the nominal robot at each pose, (n, 3, m) [m/rad], in the tracker's frame.
        robot: gives the filed tracker noise and repeatability.
    """
    radial, transverse = _reading_scales(poses, robot.tracker)
    seen, _ = _deviations(poses.joint, poses.place)
    poses = replace(poses, point=poses.point - (slope @ seen[..., None])[..., 0])
    filed = Noise(radial, transverse, robot.joints.repeatability, 0.0, 0, False)
    covariance = filed.covariance(poses, slope, robot.tracker)
    known: dict[bytes, _Visits] = {}

    def by_conditions(place: Index) -> _Visits:
        """`_by_conditions`, computed once for the same labels: gross errors are rare."""
        labels = place.tobytes()
        if labels not in known:
            known[labels] = _by_conditions(poses, place, slope)
        return known[labels]

    separable = 3 * by_conditions(poses.place).degrees >= 2 * _ENOUGH
    repeat, place = _without_gross(poses, covariance, by_conditions)
    visits = (
        by_conditions(place)
        if separable  # noise from conditions; else true repeats tell it
        else _visits(poses.point, repeat)
    )
    few = 3 * visits.degrees < _ENOUGH
    if few:
        visits = _visits(poses.point, place, _plain_course(poses, place, slope))
    degrees = visits.degrees
    floor = float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean()))
    stated = replace(filed, floor=floor, most=_most(_visits(poses.point, place), covariance))
    if 3 * degrees < _ENOUGH:
        return stated
    if few and (radial, transverse) == _AS_FILED:
        found = _in_proportion(filed, visits, covariance)
        less = _hardly_less(found.transverse_scale, transverse, found.freedom)
        return stated if less else found
    reading = filed.reading(poses.point, robot.tracker) / poses.count[:, None, None]
    moving = slope @ np.swapaxes(slope, 1, 2)
    bounds = _LEAST * robot.commanded.joint_size, _MOST * robot.commanded.joint_size
    if (radial, transverse) == _AS_FILED:
        free = _without_displacements(visits, poses)
        if 3 * free.degrees >= _ENOUGH:
            radial = transverse = _tracker_scale(
                lambda k: _likeliest(free, k**2 * reading, moving, bounds).unlikeliness
            )
            reading = radial**2 * reading
    best = _likeliest(visits, reading, moving, bounds)
    found = Noise(radial, transverse, best.sigma, visits.floor, degrees, True, best.freedom)
    less = few and _hardly_less(best.sigma, filed.repeatability, best.freedom)
    return stated if less else found


def _most(visits: _Visits, covariance: Array) -> float:
    """Largest factor on the noise that the deviations of visits allow (95 %); inf without any.

    All that changes between two visits counts as noise.

    Args:
        visits: of places, gross errors in places of their own.
        covariance: of each pose, (n, 3, 3).
    """
    degrees = 3.0 * visits.degrees
    white = (whitening(covariance) @ visits.deviation[..., None])[..., 0]
    if not degrees:
        return np.inf
    return float(np.sqrt(np.sum(white**2) / degrees)) * interval_of(degrees)[1]


def _hardly_less(found: float, stated: float, freedom: float) -> bool:
    """Whether an estimate is less than what the robot file states, but does not refute it.

    An estimate of few visits that is lower by chance would show errors that do not exist.

    Args:
        found: standard deviation from few visits.
        stated: that of the robot file.
        freedom: degrees of freedom of the estimate.
    """
    return found < stated < interval_of(freedom)[1] * found


def interval_of(freedom: float) -> tuple[float, float]:
    """Ends of the 95 % interval of a standard deviation, as factors on its estimate.

    Args:
        freedom: degrees of freedom of the estimate.
    """
    if not np.isfinite(freedom):
        return 1.0, 1.0
    chi = np.array([chdtri(freedom, 0.025), chdtri(freedom, 0.975)])
    with np.errstate(divide="ignore"):
        low, high = np.sqrt(freedom / chi)
    return min(1.0, float(low)), float(high)


def _in_proportion(filed: Noise, visits: _Visits, covariance: Array) -> Noise:
    """The filed noise of tracker and joints times one factor: few visits do not part the two.

    Args:
        filed: noise of the robot file.
        visits: of places, with the changes that the conditions may cause.
        covariance: of each pose by the filed noise, (n, 3, 3).
    """
    found = _likeliest(visits, np.zeros_like(covariance), covariance, _FACTORS)
    return Noise(
        found.sigma * filed.radial_scale,
        found.sigma * filed.transverse_scale,
        found.sigma * filed.repeatability,
        visits.floor,
        visits.degrees,
        True,
        found.freedom,
        in_proportion=True,
    )


def _tracker_scale(unlikeliness: Callable[[float], float]) -> float:
    """Scale of the tracker's noise from repeats of single readings.

    Repeats alone hardly distinguish a noisy tracker from joints that do not repeat. The robot
    file's noise, scale 1, is kept unless the repeats refute it: along directions in which the
    joints move the reflector little, they scatter more than it allows.

    Args:
        unlikeliness: -2 ln of the likelihood of such a scale.
    """
    from scipy.optimize import minimize_scalar  # slow to load

    filed = unlikeliness(1.0)
    if unlikeliness(_SLIGHTLY) > filed:
        return 1.0
    best = minimize_scalar(
        lambda log_k: unlikeliness(float(np.exp(log_k))),
        bounds=(0.0, np.log(_LOUDEST)),
        method="bounded",
        options={"xatol": 1e-2},
    )
    return float(np.exp(best.x)) if filed - best.fun > _REFUTED else 1.0


def _without_displacements(visits: _Visits, poses: Poses) -> _Visits:
    """Visits whose noise excludes displacements by the conditions in any direction.

    A base that sinks or a column that grows moves the reflector as no joint can. Displacements are
    linear in the place.
    """
    mean = poses.point - visits.deviation  # of a place: its noise is not that of a visit
    about = mean - mean.mean(axis=0)
    plane = np.column_stack([np.ones(len(poses)), about / max(float(np.abs(about).max()), 1e-9)])
    moved = _by_condition(poses, plane)[:, None, :, None] * np.eye(3)[:, None, :]
    within = _deviations(moved.reshape(len(poses), -1), visits.place)[0]
    within = within.reshape(visits.deviation.size, -1)
    return replace(visits, course=_basis(np.hstack([visits.course, within])))


def whitening(covariance: Array) -> Array:
    """Whitening matrices W with W C W^T = 1, (n, d, d) as C; [1/m] for positions."""
    return np.linalg.inv(np.linalg.cholesky(covariance))


def _reading_scales(poses: Poses, tracker: Tracker) -> tuple[float, float]:
    """Estimated over filed standard deviation of a reading, along and across the beam."""
    several = poses.count > 1
    degrees = (poses.count[several] - 1).astype(float)
    if degrees.sum() < _ENOUGH:
        return _AS_FILED
    distance, beam = (each[several] for each in _beams(poses.point))
    along, across = tracker.sigmas(distance)
    scatter = poses.scatter[several]
    radial = np.einsum("ni,nij,nj->n", beam, scatter, beam)
    transverse = (np.trace(scatter, axis1=1, axis2=2) - radial) / 2
    share = degrees / degrees.sum()
    scales = np.sqrt(share @ (radial / along**2)), np.sqrt(share @ (transverse / across**2))
    return max(float(scales[0]), 1e-3), max(float(scales[1]), 1e-3)


def _without_gross(
    poses: Poses, covariance: Array, by_conditions: Callable[[Index], _Visits]
) -> tuple[Index, Index]:
    """Labels of repeats and places with gross errors as unrepeated, so that they are no noise.

    A knocked reflector is no noise. Poses over 6 robust standard deviations from the mean of their
    repeat, 20 from that of their place, or 12 from what the conditions explain, are not used.
    """
    white = whitening(covariance)
    repeat, gross = _without(poses.repeat, white, lambda each: _visits(poses.point, each))
    place = _alone(poses.place, gross)
    # where the conditions could explain nearly all, they would explain the gross errors as well
    place, _ = _without(place, white, lambda each: _visits(poses.point, each), _FAR)
    place, _ = _without(place, white, by_conditions, _LEFT_FAR)
    return repeat, place


def _without(
    label: Index, white: Array, visits: Callable[[Index], _Visits], gross_from: float = _GROSS
) -> tuple[Index, NDArray[np.bool_]]:
    """Labels of visits with the gross errors in groups of their own, and where these are.

    The largest are found first, as they draw means and courses, and so deviations of others.
    """
    found = np.zeros(len(label), dtype=bool)
    while (gross := _gross(visits(label), white, gross_from)).any():
        label, found = _alone(label, gross), found | gross
    return label, found


def _alone(label: Index, rows: NDArray[np.bool_]) -> Index:
    """Labels of groups (n,), with some rows in groups of their own."""
    new = label.copy()
    new[rows] = label.max() + 1 + np.arange(int(rows.sum()))
    return new


def _gross(visits: _Visits, white: Array, gross_from: float) -> NDArray[np.bool_]:
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


@dataclass(frozen=True)
class _Visits:
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


def _visits(point: Array, place: Index, course: Array | None = None) -> _Visits:
    course = np.zeros((point.size, 0)) if course is None else course
    return _Visits(place, _deviations(point, place)[0], course)


def _by_conditions(poses: Poses, place: Index, slope: Array) -> _Visits:
    """Visits of each place, with the changes that the conditions may cause."""
    return _visits(poses.point, place, _course(poses, place, slope))


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
    return _basis(_deviations(columns, place)[0].reshape(3 * len(poses), -1))


def _plain_course(poses: Poses, place: Index, slope: Array) -> Array:
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
    return _basis(_deviations(columns, place)[0].reshape(3 * len(poses), -1))


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


def _deviations(values: Array, label: Index) -> tuple[Array, int]:
    """Each row (n, k) less its group's mean, and the degrees of freedom (rows less groups)."""
    size, width = np.bincount(label), values.shape[1]
    cell = label[:, None] * width + np.arange(width)
    total = np.bincount(cell.ravel(), values.ravel(), len(size) * width).reshape(-1, width)
    deviation = values - (total / np.maximum(size, 1)[:, None])[label]
    return deviation, int((size[size > 0] - 1).sum())


def turn_noise(
    turned: Array, poses: Poses, slope: Array, repeatability: float, stated: float
) -> float:
    """Standard deviation of one reading of the rotation about each axis [rad].

    The maximum likelihood estimate from the differences of repeats without gross errors, given the
    rest errors of the joints; of visits to a place, if there are too few; else the robot file's.

    Args:
        turned: small rotation vectors from one pose of the same place to each, (n, 3) [rad].
        poses: the measured poses.
        slope: derivative of the rotation by the joints, (n, 3, m).
        repeatability: standard deviation of a joint's rest error.
        stated: the robot file's value [rad].
    """
    reading = np.eye(3) / poses.count[:, None, None]
    resting = repeatability**2 * slope @ np.swapaxes(slope, 1, 2)
    white = whitening(resting + stated**2 * reading)
    repeat, gross = _without(poses.repeat, white, lambda each: _visits(turned, each))
    visits = _visits(turned, repeat)
    few = 3 * visits.degrees < _ENOUGH
    if few:
        place = _alone(poses.place, gross)
        place, _ = _without(place, white, lambda each: _visits(turned, each), _FAR)
        visits = _visits(turned, place, _plain_course(poses, place, slope))
    if 3 * visits.degrees < _ENOUGH:
        return stated
    found = _likeliest(visits, resting, reading, (_LEAST, _MOST))
    less = few and _hardly_less(found.sigma, stated, found.freedom)
    return stated if less else found.sigma


@dataclass(frozen=True)
class _Likeliest:
    """Most likely standard deviation of a part of the noise."""

    sigma: float
    freedom: float  # its degrees of freedom
    unlikeliness: float  # -2 ln of the restricted likelihood


def _likeliest(
    visits: _Visits, fixed: Array, growing: Array, bounds: tuple[float, float]
) -> _Likeliest:
    """Most likely s of the covariance F + s^2 G, and its degrees of freedom by the curvature.

    Restricted likelihood of Gaussian errors, one draw a move: the means of places and the effects
    of conditions are fitted with the covariance that s gives, and the degrees of freedom that they
    use do not bias s (Patterson and Thompson 1971, Biometrika 58, 545-554).

    Args:
        visits: deviations within places.
        fixed: F of each pose, (n, 3, 3).
        growing: G of each pose, (n, 3, 3).
        bounds: interval in which s is searched.
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
    width, size = columns.shape[2], -2 * float(np.linalg.slogdet(turn)[1].sum())

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
        spread += np.log(variance).sum() + size
        return float(spread + whole[-1, -1] - beside @ solved(known, beside))

    best = minimize_scalar(
        unlikeliness, bounds=np.log(bounds), method="bounded", options={"xatol": 1e-3}
    )
    bend = unlikeliness(best.x - _STEP) - 2 * best.fun + unlikeliness(best.x + _STEP)
    # the curvature of -2 log L by log s is four times that by log s^2
    freedom = max(bend / _STEP**2 / 4, _FEWEST_DEGREES)
    return _Likeliest(float(np.exp(best.x)), freedom, float(best.fun))


def _apart(fixed: Array, growing: Array) -> tuple[Array, Array]:
    """Diagonalize two covariances F and G of each sample, both (n, 3, 3), simultaneously.

    T (n, 3, 3) with T F T^T = 1 and T G T^T diagonal, and that diagonal (n, 3).
    """
    white = whitening(fixed)
    growth, way = np.linalg.eigh(white @ growing @ white.transpose(0, 2, 1))
    return way.transpose(0, 2, 1) @ white, growth
