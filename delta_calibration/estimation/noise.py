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
from delta_calibration.estimation.visits import (
    Visits,
    alone,
    deviations,
    plain_course,
    visits_by_conditions,
    visits_of,
    without_displacements,
    without_gross_errors,
)
from delta_calibration.robot import Robot, Tracker

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# degrees of freedom from which a standard deviation is estimated, not taken from the robot file
_ENOUGH = 20
# standard deviations beyond which a visit is a gross error: of what conditions leave, from where a
# fit sets a pose aside; where causes have a part in the deviations, a few times their median
_LEFT_FAR, _FAR = 12.0, 20.0
_STEP = 0.05  # step of log s_q in the second difference of its likelihood
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
    seen = deviations(poses.joint, poses.place)
    poses = replace(poses, point=poses.point - (slope @ seen[..., None])[..., 0])
    filed = Noise(radial, transverse, robot.joints.repeatability, 0.0, 0, False)
    covariance = filed.covariance(poses, slope, robot.tracker)
    known: dict[bytes, Visits] = {}

    def by_conditions(place: Index) -> Visits:
        """`visits_by_conditions`, computed once for the same labels: gross errors are rare."""
        labels = place.tobytes()
        if labels not in known:
            known[labels] = visits_by_conditions(poses, place, slope)
        return known[labels]

    separable = 3 * by_conditions(poses.place).degrees >= 2 * _ENOUGH
    repeat, place = _without_gross(poses, covariance, by_conditions)
    visits = (
        by_conditions(place)
        if separable  # noise from conditions; else true repeats tell it
        else visits_of(poses.point, repeat)
    )
    few = 3 * visits.degrees < _ENOUGH
    if few:
        visits = visits_of(poses.point, place, plain_course(poses, place, slope))
    degrees = visits.degrees
    floor = float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean()))
    stated = replace(filed, floor=floor, most=_most(visits_of(poses.point, place), covariance))
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
        free = without_displacements(visits, poses)
        if 3 * free.degrees >= _ENOUGH:
            radial = transverse = _tracker_scale(
                lambda k: _likeliest(free, k**2 * reading, moving, bounds).unlikeliness
            )
            reading = radial**2 * reading
    best = _likeliest(visits, reading, moving, bounds)
    found = Noise(radial, transverse, best.sigma, visits.floor, degrees, True, best.freedom)
    less = few and _hardly_less(best.sigma, filed.repeatability, best.freedom)
    return stated if less else found


def _most(visits: Visits, covariance: Array) -> float:
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


def _in_proportion(filed: Noise, visits: Visits, covariance: Array) -> Noise:
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
    poses: Poses, covariance: Array, by_conditions: Callable[[Index], Visits]
) -> tuple[Index, Index]:
    """Labels of repeats and places with gross errors as unrepeated, so that they are no noise.

    A knocked reflector is no noise. Poses over 6 robust standard deviations from the mean of their
    repeat, 20 from that of their place, or 12 from what the conditions explain, are not used.
    """
    white = whitening(covariance)

    def plain(label: Index) -> Visits:
        return visits_of(poses.point, label)

    repeat, gross = without_gross_errors(poses.repeat, white, plain)
    place = alone(poses.place, gross)
    # where the conditions could explain nearly all, they would explain the gross errors as well
    place, _ = without_gross_errors(place, white, plain, _FAR)
    place, _ = without_gross_errors(place, white, by_conditions, _LEFT_FAR)
    return repeat, place


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
    repeat, gross = without_gross_errors(poses.repeat, white, lambda each: visits_of(turned, each))
    visits = visits_of(turned, repeat)
    few = 3 * visits.degrees < _ENOUGH
    if few:
        place = alone(poses.place, gross)
        place, _ = without_gross_errors(place, white, lambda each: visits_of(turned, each), _FAR)
        visits = visits_of(turned, place, plain_course(poses, place, slope))
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
    visits: Visits, fixed: Array, growing: Array, bounds: tuple[float, float]
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
