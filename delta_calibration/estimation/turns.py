"""How the platform is turned, as a probe of six degrees of freedom says it: what a session has.

The law is `PoseMeasured` in `measurements.py`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.chain import Chain
from delta_calibration.data import Poses
from delta_calibration.errors import DataError
from delta_calibration.estimation.measurements import PoseMeasured
from delta_calibration.estimation.noise import Noise
from delta_calibration.geometry import rotations
from delta_calibration.robot import Robot

Array = NDArray[np.float64]


def turns_of(poses: Poses, robot: Robot, chain: Chain) -> Array | None:
    """Measured rotations of a session's probe, (n, 3, 3), where they take part.

    They do where the session has them, the robot's file says how sure they are
    (`tracker.turn_urad`), and the platform of the model turns.

    Raises:
        DataError: a quaternion of no length.
    """
    told = robot.tracker.measures == "pose" and robot.tracker.turn is not None
    if poses.quaternion is None or not told:
        return None
    mechanism = chain.mechanism
    home = mechanism.forward(mechanism.home[None], mechanism.parameters.nominal)
    if not mechanism.turn_by_pose(home).any():
        return None
    size = np.linalg.norm(poses.quaternion, axis=1)
    if not (size > 0).all():
        bad = int(np.argmin(size > 0))
        value = poses.quaternion[bad]
        raise DataError(f"{poses.source}: pose {bad + 1}: quaternion {value} is no rotation")
    return rotations.from_quaternion(poses.quaternion)


def mount_of(rotation: Array, chain: Chain, x: Array, theta: Array) -> Array:
    """How the probe seems to be mounted, (3,) [rad].

    Args:
        rotation: of the probe in the tracker's frame, (n, 3, 3).
        chain: of the cell.
        x: poses of the platform, (n, k).
        theta: of the chain.
    """
    platform = chain.split(theta)[2].rotation @ chain.mechanism.rotation(x)
    seen = Rotation.from_matrix(np.swapaxes(platform, 1, 2) @ rotation)
    return np.asarray(seen.mean().as_rotvec())


def pose_covariance(
    seen: PoseMeasured, poses: Poses, robot: Robot, chain: Chain, noise: Noise, theta: Array
) -> Array:
    """Covariance of positions and turns together, (n, 6, 6) [m, rad].

    A joint that comes to rest beside its command moves and turns the platform at once.

    Args:
        seen: what was measured.
        poses: the same, with how many readings each is of.
        robot: says how sure a reading is.
        chain: nominal, at `theta`.
        noise: of the positions.
        theta: of the chain.
    """
    both = seen.linearized(chain.predictor(poses.conditions), theta).by_joints
    covariance = noise.repeatability**2 * both @ np.swapaxes(both, 1, 2)
    covariance[:, :3, :3] = noise.covariance(poses, both[:, :3], robot.tracker)
    covariance[:, 3:, 3:] += (seen.turn_noise**2 / poses.count)[:, None, None] * np.eye(3)
    return np.asarray(covariance)
