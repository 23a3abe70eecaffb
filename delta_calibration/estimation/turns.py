"""Orientation measurements of a session, by a probe with six degrees of freedom.

The measurement equation is `PoseMeasured` in `measurements.py`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.chain import Chain
from delta_calibration.data import Poses
from delta_calibration.errors import DataError
from delta_calibration.estimation.measurements import Measured, PoseMeasured
from delta_calibration.estimation.noise import Noise, turn_noise, whitening
from delta_calibration.estimation.problem import Problem
from delta_calibration.geometry import rotations
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_SAME = 1e-9  # difference of quaternion entries under which they count as one value


def turns_of(poses: Poses, robot: Robot, chain: Chain) -> Array | None:
    """Measured rotations of a session's probe, (n, 3, 3), or None if they are not fitted.

    They are fitted if the session has them, the robot file states their noise
    (`tracker.turn_urad`), the platform of the model rotates, and they were measured: see `held`.

    Raises:
        DataError: a quaternion of zero length.
    """
    if poses.quaternion is None or not _asked(robot, chain) or held(poses.quaternion):
        return None
    size = np.linalg.norm(poses.quaternion, axis=1)
    if not (size > 0).all():
        bad = int(np.argmin(size > 0))
        value = poses.quaternion[bad]
        raise DataError(f"{poses.source}: pose {bad + 1}: quaternion {value} is no rotation")
    return rotations.from_quaternion(poses.quaternion)


def never_turned(poses: Poses, robot: Robot, chain: Chain) -> bool:
    """Whether rotations would be fitted, but the session has the same one in all poses."""
    asked = poses.quaternion is not None and _asked(robot, chain)
    return asked and held(poses.quaternion)


def held(quaternion: Array | None) -> bool:
    """Whether all quaternions (n, 4) are equal: filled in, not measured."""
    return quaternion is not None and bool((np.ptp(quaternion, axis=0) < _SAME).all())


def _asked(robot: Robot, chain: Chain) -> bool:
    """Whether the robot file states the noise of rotations, and the platform rotates."""
    if robot.tracker.measures != "pose" or robot.tracker.turn is None:
        return False
    mechanism = chain.mechanism
    home = mechanism.forward(mechanism.home[None], mechanism.parameters.nominal)
    return bool(mechanism.turn_by_pose(home).any())


def with_turns(problem: Problem, poses: Poses, robot: Robot, noise: Noise) -> Problem:
    """Extend a problem of positions by the measured rotations, if they are fitted.

    The noise of a rotation comes from repeats; if these are too few, from the robot file.

    Args:
        problem: as returned by `prepare`.
        poses: the measured poses.
        robot: states the noise of a reading.
        noise: of the positions.

    Raises:
        DataError: a quaternion of zero length.
    """
    chain, start = problem.chain, problem.theta0
    turned, stated = turns_of(poses, robot, chain), robot.tracker.turn
    if turned is None or stated is None:
        return problem
    seen = PoseMeasured(poses.joint, poses.point, None, noise.floor, turned, stated)
    by_joints = seen.linearized(chain.predictor(poses.conditions), start).by_joints[:, 3:]
    _, first, place = np.unique(poses.place, return_index=True, return_inverse=True)
    away = rotations.log(turned @ np.swapaxes(turned[first[place]], 1, 2))
    noise_of_turns = turn_noise(away, poses, by_joints, noise.repeatability, stated)
    seen = replace(seen, turn_noise=noise_of_turns)
    whiten = whitening(pose_covariance(seen, poses, robot, chain, noise, start))
    mount = mount_of(turned, chain, chain.pose(problem.at, start), start)
    return problem.mounted(Measured(seen, problem.at, given=whiten), mount)


def mount_of(rotation: Array, chain: Chain, x: Array, theta: Array) -> Array:
    """Estimate the probe's mounting orientation on the platform, rotation vector (3,) [rad].

    Args:
        rotation: of the probe in the tracker's frame, (n, 3, 3).
        chain: of the cell.
        x: poses of the platform, (n, k).
        theta: of the chain.
    """
    platform = chain.split(theta)[2].rotation @ chain.mechanism.rotation(x)  # effects are small
    seen = Rotation.from_matrix(np.swapaxes(platform, 1, 2) @ rotation)
    return np.asarray(seen.mean().as_rotvec())


def pose_covariance(
    seen: PoseMeasured, poses: Poses, robot: Robot, chain: Chain, noise: Noise, theta: Array
) -> Array:
    """Covariance of positions and turns together, (n, 6, 6) [m, rad].

    The rest error of a joint shifts and rotates the platform together.

    Args:
        seen: the measured poses, as an observation.
        poses: the same poses, with their numbers of readings.
        robot: states the noise of a reading.
        chain: nominal, at `theta`.
        noise: of the positions.
        theta: of the chain.
    """
    both = seen.linearized(chain.predictor(poses.conditions), theta).by_joints
    covariance = noise.repeatability**2 * both @ np.swapaxes(both, 1, 2)
    covariance[:, :3, :3] = noise.covariance(poses, both[:, :3], robot.tracker)
    covariance[:, 3:, 3:] += (seen.turn_noise**2 / poses.count)[:, None, None] * np.eye(3)
    return np.asarray(covariance)
