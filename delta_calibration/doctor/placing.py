"""Fits the nominal robot to the tracker: how well a session's stops agree with the drawing.

The tracker's frame and the reflector's offset are free, the machine's dimensions are not: this is
cheap, and enough to detect mistakes that no manufacturing error explains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Session
from delta_calibration.doctor.change import joint_streams, joints_of
from delta_calibration.errors import CalibrationError
from delta_calibration.estimation import chain_of
from delta_calibration.geometry import Frame, carried_step, rotations
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_ROUNDS = 12
_SETTLED = 1e-3  # relative change of the distance in a round that counts as converged
_MOST_LOST = 0.3  # largest share of the stops that may be out of the nominal robot's reach
_TURNS = 0.01  # [rad] least rotation of a platform for which the reflector's offset matters


@dataclass(frozen=True)
class Placed:
    """Result of fitting the nominal robot's frame to the tracker's points.

    Rows of stops that are out of the nominal robot's reach are NaN.
    """

    typical: float  # [m] median residual; infinite if too many stops are out of reach
    frame: Frame  # T_tracker_base
    offset: Array  # (3,) [m] of the reflector
    pose: Array  # (n, k)
    turned: Array  # (n, 3, 3) rotation of the platform in the base
    base: Array  # (n, 3) [m] reflector in the base
    left: Array  # (n, 3) [m] residual: measured less predicted
    scale: float = 1.0
    turns: bool = False  # whether the platform rotates enough for the reflector's offset to matter

    @property
    def found(self) -> bool:
        """Whether a fit exists: enough stops are in reach."""
        return bool(np.isfinite(self.typical))


NOWHERE = Placed(
    np.inf,
    Frame.identity(),
    np.zeros(3),
    np.zeros((0, 6)),
    np.zeros((0, 3, 3)),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
)


def place(
    stops: Session, robot: Robot, stream: str = "", loose: bool = False, apart: bool = False
) -> Placed:
    """Fit the frame of the nominal robot to the tracker's points robustly.

    Args:
        stops: of the session, see `stops_of`.
        robot: its nominal dimensions.
        stream: joint stream to use; by default the one that a fit uses.
        loose: let the scale of the tracker's frame vary, so that a wrong scale does not make one
            joint stream seem better than another.
        apart: allow a left-handed tracker frame.
    """
    joint, point = joints_and_points(stops, stream)
    try:
        pose = robot.model().forward(joint, robot.model().parameters.nominal)
    except (CalibrationError, np.linalg.LinAlgError, FloatingPointError):
        return NOWHERE
    return place_poses(pose, point, robot, loose, apart)


def joints_and_points(stops: Session, stream: str = "") -> tuple[Array, Array]:
    """Joints (n, m) that a fit uses, and the tracker's points (n, 3) [m]."""
    name = stream or joint_streams(stops)[-1]
    joints = joints_of(stops, name)
    assert joints is not None
    assert stops.tracker is not None
    return joints.position, stops.tracker.position


def place_poses(
    pose: Array, point: Array, robot: Robot, loose: bool = False, apart: bool = False
) -> Placed:
    """Fit the frame, as `place`, to given poses (n, k) of the nominal robot."""
    mechanism, tracker = robot.model(), robot.tracker
    reached = np.isfinite(pose).all(axis=1)
    if reached.mean() < 1 - _MOST_LOST or reached.sum() < 4:
        return NOWHERE
    y, centre_all, turned_all = point[reached], mechanism.position(pose), mechanism.rotation(pose)
    centre, turned = centre_all[reached], turned_all[reached]
    offset = np.array(tracker.reflector_offset, dtype=float)
    turns = float(np.abs(turned - turned[0]).max()) > _TURNS
    rotation, scale, shift = similarity(centre + turned @ offset, y, np.ones(len(y)), loose, apart)
    weight, frame = np.ones(len(y)), Frame(scale * rotation, shift)
    before = np.inf
    for _ in range(_ROUNDS):
        predicted = frame.apply(centre + turned @ offset)
        left = y - predicted
        distance = np.linalg.norm(left, axis=1)
        typical = float(np.median(distance))
        if not 0 < typical < np.inf or abs(before - typical) < _SETTLED * typical:
            break
        before = typical
        weight = 1 / (1 + (distance / (2 * typical)) ** 2)
        if turns:
            offset = _offset(offset, frame, turned, predicted, left, weight, typical, robot)
        source = centre + turned @ offset
        rotation, scale, shift = similarity(source, y, weight, loose, apart)
        frame = Frame(scale * rotation, shift)
    base_all = centre_all + turned_all @ offset
    left_all = point - frame.apply(base_all)
    away = np.linalg.norm(np.nan_to_num(left_all, nan=np.inf), axis=1) / abs(scale)
    typical = float(np.median(away))
    return Placed(typical, frame, offset, pose, turned_all, base_all, left_all, scale, turns)


def _offset(
    offset: Array,
    frame: Frame,
    turned: Array,
    predicted: Array,
    left: Array,
    weight: Array,
    typical: float,
    robot: Robot,
) -> Array:
    """Improved offset of the reflector, (3,) [m], with the frame free."""
    tracker = robot.tracker
    about = predicted - predicted.mean(axis=0)
    pull = (typical / tracker.reflector_offset_prior) ** 2
    toward = tracker.reflector_offset - offset
    own = frame.rotation @ turned
    return np.asarray(offset + carried_step(own, about, left, weight, pull, toward))


def similarity(
    source: Array,
    target: Array,
    weight: Array,
    loose: bool = False,
    apart: bool = False,
) -> tuple[Array, float, Array]:
    """Rotation, scale and translation that map source to target (Umeyama 1991).

    A proper rotation with scale 1, unless `loose` (any scale) or `apart` (reflection allowed).
    """
    w = (weight / weight.sum())[:, None]
    mean_s, mean_t = (w * source).sum(axis=0), (w * target).sum(axis=0)
    s, t = source - mean_s, target - mean_t
    u, size, vt = np.linalg.svd((w * t).T @ s)
    sign = np.array([1.0, 1.0, 1.0 if apart else np.sign(np.linalg.det(u @ vt))])
    rotation = u @ np.diag(sign) @ vt
    spread = float((w * s**2).sum())
    scale = float(size @ sign) / spread if loose and spread > 0 else 1.0
    return rotation, scale, mean_t - scale * rotation @ mean_s


def expected(placed: Placed, robot: Robot, joint: Array) -> float:
    """Typical displacement of the reflector by deviations of one tolerance [m].

    Median over the stops.
    """
    mechanism = chain_of(robot).mechanism
    good = np.isfinite(placed.pose).all(axis=1)
    q, x = joint[good], placed.pose[good]
    parameters = mechanism.parameters
    known = np.isfinite(parameters.prior)
    slope = mechanism.identification_jacobian(q, x, parameters.nominal)
    moved = mechanism.point_by_pose(x, placed.offset) @ slope
    size = np.linalg.norm(moved[..., known] * parameters.prior[known], axis=(1, 2))
    size = size[np.isfinite(size)]
    return float(np.median(size)) if size.size else np.inf


def turned_by(placed: Placed, quaternion: Array) -> tuple[Array, Array]:
    """Rotation of the probe on the platform: mean (3, 3), and each stop's deviation (n,) [rad]."""
    good = np.isfinite(placed.pose).all(axis=1)
    turned = placed.frame.rotation @ placed.turned[good]
    mount = np.swapaxes(turned, 1, 2) @ rotations.from_quaternion(quaternion[good])
    mean = _nearest(np.median(mount, axis=0))
    for _ in range(5):
        about = np.linalg.norm(rotations.log(mean.T @ mount), axis=1)
        weight = 1 / (1 + (about / max(2 * float(np.median(about)), 1e-9)) ** 2)
        mean = _nearest(np.einsum("n,nij->ij", weight, mount))
    return mean, np.linalg.norm(rotations.log(mean.T @ mount), axis=1)


def _nearest(matrix: Array) -> Array:
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
