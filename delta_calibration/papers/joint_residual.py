"""Residuals in joint coordinates: encoder readings less the joints of the measured poses.

    e = theta - theta(F^-1 y, g)        paper 002 (3): e = theta - (l - l_0) / k

theta: joints; y: poses as the device measures them; F = `T_device_robot`: the robot's frame in the
device's; g: geometry. Valid for mechanisms with explicit inverse kinematics: one closure equation
per joint, and all coordinates of the pose commanded. The forward kinematics are not needed, so no
equation is solved iteratively; the weights have to account for the influence of the device's noise
on the joints (`joint_covariance`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError, InputError
from delta_calibration.geometry import Frame, align, rotations
from delta_calibration.mechanisms import Mechanism
from delta_calibration.mechanisms.base import solve
from delta_calibration.theta import Layout, frame_names

Array = NDArray[np.float64]

FRAME_NAMES = frame_names("robot")
FRAME_STEP = 1e-3  # typical size of a frame's coordinate, which has no prior [rad, m]


@dataclass(frozen=True)
class JointProblem:
    """Problem of fitting geometry and frame to joints and measured poses.

    Unknowns in the order geometry (p), frame (6): rotation and shift of the robot in its own axes.
    """

    mechanism: Mechanism
    joint: Array  # (n, m) [rad] encoder readings
    pose: Array  # (n, k) in the device's frame [m, rad]: position, and rotation vector if k is 6
    whiten: Array  # (n, m, m) [1/rad], see estimation.noise.whitening
    priors: bool = True  # False: plain least squares, as paper 002 has it

    def __post_init__(self) -> None:
        """Refuse input for which residuals in joint coordinates do not exist.

        Raises:
            InputError: a mechanism without explicit inverse kinematics, or arrays of wrong shape.
        """
        robot, n = self.mechanism, len(self.joint)
        home, g = robot.home[None], robot.parameters.nominal
        rows = robot.closure(home, robot.start(home, g), g).shape[1]
        if rows != robot.joints or robot.pose_size != robot.task_size:
            raise InputError(
                f"{robot.name}: {rows} closures for {robot.joints} joints and {robot.pose_size} "
                f"coordinates of the pose, {robot.task_size} of them commanded, are not allowed; "
                "one closure a joint and every coordinate commanded"
            )
        for name, value, shape in (
            ("joint", self.joint, (n, robot.joints)),
            ("pose", self.pose, (n, robot.pose_size)),
            ("whiten", self.whiten, (n, robot.joints, robot.joints)),
        ):
            if value.shape != shape or not np.isfinite(value).all():
                raise InputError(f"{name}: {value.shape} is not allowed; {shape}, finite")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, (p + 6,)."""
        return self.mechanism.parameters.names + FRAME_NAMES

    @property
    def layout(self) -> Layout:
        """Layout of the unknowns; the reflector's offset is not among them."""
        return Layout(len(self.mechanism.parameters), has_offset=False)

    @property
    def scale(self) -> Array:
        """Expected size of each unknown, (p + 6,): its prior, else a millimetre or milliradian."""
        prior = self.mechanism.parameters.prior
        scale = np.full(self.layout.size, FRAME_STEP)
        scale[self.layout.geometry] = np.where(np.isfinite(prior), prior, FRAME_STEP)
        return scale

    def in_robot(self, frame: Frame) -> Array:
        """The measured poses in the robot's frame, (n, k); `frame` is `T_device_robot`."""
        back = frame.inverse()
        position = back.apply(self.pose[:, :3])
        if self.mechanism.pose_size == 3:
            return position
        turn = rotations.log(back.rotation @ rotations.exp(self.pose[:, 3:]))
        return np.concatenate([position, turn], axis=1)

    def residual(self, geometry: Array, frame: Frame) -> Array:
        """Residuals e, (n, m) [rad]; NaN where a measured pose is out of the geometry's reach."""
        return self.joint - self.mechanism.inverse(self.in_robot(frame), geometry)

    def slopes(self, geometry: Array, frame: Frame) -> Array:
        """-de/d(unknowns), (n, m, p + 6), by the implicit function theorem at constant pose."""
        x = self.in_robot(frame)
        q = self.mechanism.inverse(x, geometry)
        by_joints = self.mechanism.closure_by_joints(q, x, geometry)
        by_geometry = -solve(by_joints, self.mechanism.closure_by_geometry(q, x, geometry))
        by_pose = -solve(by_joints, self.mechanism.closure_by_pose(q, x, geometry))
        by_turn, by_place = np.split(by_pose @ _pose_by_frame(x), 2, axis=-1)
        return self.layout.columns(by_geometry, turn=by_turn, place=by_place)

    def start_frame(self) -> Frame:
        """`T_device_robot` that fits the nominal machine's positions best.

        Raises:
            DataError: joints that the nominal machine cannot take, or places on one line.
        """
        robot = self.mechanism
        x = robot.forward(self.joint, robot.parameters.nominal)
        robot.require_reach(x, self.joint, "recorded joint command")
        return align(robot.position(x), self.pose[:, :3])

    def require_enough(self) -> None:
        """Refuse fewer residuals than unknowns.

        Raises:
            DataError: states the number of poses, and the number needed.
        """
        unknowns, joints = len(self.names), self.mechanism.joints
        fewest = -(-unknowns // joints)
        if len(self.joint) < fewest:
            raise DataError(
                f"{len(self.joint)} measured poses of {joints} joints cannot set {unknowns} "
                f"unknowns; {fewest} or more"
            )


def joint_covariance(
    mechanism: Mechanism, pose: Array, pose_covariance: Array, joint_sigma: float
) -> Array:
    """Covariance of the residuals e, (n, m, m) [rad^2]: rest errors, and pose noise through dq/dx.

    Args:
        mechanism: evaluated at its nominal geometry.
        pose: approximate measured poses, in the robot's frame, (n, k).
        pose_covariance: of a measured pose in the robot's axes, (k, k).
        joint_sigma: standard deviation of a joint's rest position [rad].
    """
    g = mechanism.parameters.nominal
    q = mechanism.inverse(pose, g)
    mechanism.require_reach(q, pose, "measured pose", "m")
    slope = solve(mechanism.closure_by_joints(q, pose, g), mechanism.closure_by_pose(q, pose, g))
    own = joint_sigma**2 * np.eye(mechanism.joints)
    return np.asarray(own + slope @ pose_covariance @ np.swapaxes(slope, 1, 2))


def _pose_by_frame(x: Array) -> Array:
    """Derivative of a pose in the robot's frame by rotation and shift of the robot, (n, k, 6)."""
    n, k = x.shape
    slope = np.zeros((n, k, 6))
    slope[:, :3, :3] = rotations.skew(x[:, :3])  # -w x P
    slope[:, :3, 3:] = -np.eye(3)
    if k == 6:
        slope[:, 3:, :3] = -np.linalg.inv(rotations.left_jacobian(x[:, 3:]))
    return slope
