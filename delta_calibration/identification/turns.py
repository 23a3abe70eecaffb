"""How the platform is turned, as a probe of six degrees of freedom says it.

    R_measured = exp([e]x) R_T R(x) R(m)

R_T: the tracker's frame; R(x): the platform's turn; m: how the probe is mounted on the platform,
three more unknowns, behind those of the chain. e is what is missed, in axes of the tracker.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.chain import Chain
from delta_calibration.errors import DataError
from delta_calibration.geometry import rotations
from delta_calibration.identification.noise import Noise
from delta_calibration.robot import Robot
from delta_calibration.samples import Poses
from delta_calibration.theta import vector_names

Array = NDArray[np.float64]

MOUNT_NAMES = vector_names("probe_turn")


@dataclass(frozen=True)
class Turns:
    """Measured rotations of the probe; theta is the chain's, without effects, and m behind it."""

    rotation: Array  # (n, 3, 3) in the tracker's frame

    @classmethod
    def of(cls, poses: Poses, robot: Robot, chain: Chain) -> Turns | None:
        """Those of a session, where they take part.

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
        return cls(rotations.from_quaternion(poses.quaternion))

    def take(self, rows: NDArray[np.intp]) -> Turns:
        """Of some of the poses."""
        return Turns(self.rotation[rows])

    def mount(self, chain: Chain, x: Array, theta: Array) -> Array:
        """How the probe seems to be mounted, (3,) [rad], with the platform at poses x (n, k)."""
        platform = chain.split(theta)[2].rotation @ chain.mechanism.rotation(x)
        seen = Rotation.from_matrix(np.swapaxes(platform, 1, 2) @ self.rotation)
        return np.asarray(seen.mean().as_rotvec())

    def linearized(
        self, chain: Chain, x: Array, theta: Array, by_theta: Array
    ) -> tuple[Array, Array]:
        """e, (n, 3) [rad], and d(predicted turn)/d(theta), (n, 3, P + 3), to first order in e.

        Args:
            chain: of the cell.
            x: poses, (n, k).
            theta: with the mount, (P + 3,).
            by_theta: dx/d(theta), (n, k, P).
        """
        frame, layout = chain.split(theta)[2], chain.layout.mounted
        platform = frame.rotation @ chain.mechanism.rotation(x)
        predicted = platform @ rotations.exp(theta[layout.mount])
        slope = np.zeros((len(x), 3, layout.size))
        slope[..., layout.chain] = frame.rotation @ chain.mechanism.turn_by_pose(x) @ by_theta
        slope[..., layout.turn] = rotations.left_jacobian(theta[layout.turn])
        slope[..., layout.mount] = platform @ rotations.left_jacobian(theta[layout.mount])
        return rotations.log(self.rotation @ np.swapaxes(predicted, 1, 2)), slope


def pose_covariance(poses: Poses, robot: Robot, chain: Chain, noise: Noise, theta: Array) -> Array:
    """Covariance of positions and turns together, (n, 6, 6) [m, rad].

    A joint that comes to rest beside its command moves and turns the platform at once.

    Args:
        poses: what was measured.
        robot: says how sure a reading's turn is.
        chain: nominal, at `theta`.
        noise: of the positions.
        theta: of the chain.
    """
    sigma = robot.tracker.turn or 0.0
    predictor = chain.predictor(poses.conditions)
    seen = predictor.see(theta)
    slope, by_joints = seen.by_joints, predictor.see(theta, seen.x, "poses").by_joints
    turn = chain.split(theta)[2].rotation @ chain.mechanism.turn_by_pose(seen.x) @ by_joints
    both = np.concatenate([slope, turn], axis=1)
    covariance = noise.repeatability**2 * both @ np.swapaxes(both, 1, 2)
    covariance[:, :3, :3] = noise.covariance(poses, slope, robot.tracker)
    covariance[:, 3:, 3:] += (sigma**2 / poses.count)[:, None, None] * np.eye(3)
    return np.asarray(covariance)
