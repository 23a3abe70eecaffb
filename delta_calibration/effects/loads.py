"""Weights that a mechanism carries: generalised forces on joints, on parts and on the platform.

By energy: at the potential U(q, g) of all moving masses, a joint carries the torque dU/dq and a
dimension g of the machine the force dU/dg. A spring of stiffness k in either gives way by

    dq = -(dU/dq) / k        dg = -(dU/dg) / k

Evaluated on the nominal machine: deviations of a thousandth change a load by a thousandth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]

GRAVITY = 9.80665  # [m/s^2] standard acceleration of free fall (ISO 80000-3)


def carried_mass(robot: Robot, at: Conditions) -> Array:
    """What moves with the platform, the payload among it, (n,) [kg]."""
    return np.asarray(robot.masses.on_platform + at.payload)


def pose_of(mechanism: Mechanism, at: Conditions) -> Array:
    """Pose of the nominal machine at the encoders' angles, (n, k)."""
    nominal = mechanism.parameters.nominal
    return at.kept("pose", (mechanism,), lambda: mechanism.forward(at.joint, nominal))


def weight(robot: Robot, mechanism: Mechanism, at: Conditions, x: Array) -> Array:
    """dU/dx of what the platform carries, (n, k) [N, N m]; z is up."""
    own = (carried_mass(robot, at) - at.payload)[:, None]
    centre = mechanism.point_by_pose(x, np.zeros(3))[:, 2]
    payload = mechanism.point_by_pose(x, at.payload_centre)[:, 2]
    return np.asarray(GRAVITY * (own * centre + at.payload[:, None] * payload))


def weight_known(robot: Robot, mechanism: Mechanism, at: Conditions, x: Array) -> Array:
    """The same with an unknown payload taken for none."""
    payload, centre = np.nan_to_num(at.payload), np.nan_to_num(at.payload_centre)
    return weight(robot, mechanism, replace(at, payload=payload, payload_centre=centre), x)


def gravity_torque(robot: Robot, mechanism: Mechanism, at: Conditions) -> Array:
    """dU/dq, (n, m) [N m]: the platform through the Jacobian, arms and half rods at each joint."""
    x = pose_of(mechanism, at)
    slope = mechanism.velocity_jacobian(at.joint, x, mechanism.parameters.nominal)
    carried = np.einsum("nk,nkm->nm", weight(robot, mechanism, at, x), slope)
    arm = robot.dimensions.arm
    lever = (robot.masses.arm * robot.masses.arm_centre + robot.masses.rod) * arm
    return np.asarray(carried - GRAVITY * lever * np.cos(at.joint))


def load_on(robot: Robot, mechanism: Mechanism, at: Conditions, rows: list[int]) -> Array:
    """dU/dg of some of the geometry parameters, (n, rows) [N]."""
    x = pose_of(mechanism, at)
    slope = mechanism.identification_jacobian(at.joint, x, mechanism.parameters.nominal)
    load = np.einsum("nk,nkp->np", weight(robot, mechanism, at, x), slope[:, :, rows])
    return np.asarray(load)


def platform_acceleration(mechanism: Mechanism, at: Conditions) -> Array:
    """Second derivative of the platform centre's position along the motion, (n, 3) [m/s^2].

    By the second difference of the nominal machine's position over a moment of the motion.
    """
    nominal = mechanism.parameters.nominal
    step = 5e-3  # [s]
    there, here, back = (
        mechanism.position(
            mechanism.forward(at.joint + at.velocity * t + at.acceleration * t**2 / 2, nominal)
        )
        for t in (step, 0.0, -step)
    )
    return np.asarray((there - 2 * here + back) / step**2)
