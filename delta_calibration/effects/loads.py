"""Weight of the masses on a platform, as a generalised force on its pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.chain_constants import FREE_FALL
from delta_calibration.robot import Robot

Array = NDArray[np.float64]


def carried_mass(robot: Robot, at: Conditions) -> Array:
    """Mass that moves with the platform, including the payload, (n,) [kg]."""
    return np.asarray(robot.masses.on_platform + at.payload)


def weight(robot: Robot, mechanism: Mechanism, at: Conditions, x: Array) -> Array:
    """dU/dx of the masses on the platform, (n, k) [N, N m]; z is up."""
    own = (carried_mass(robot, at) - at.payload)[:, None]
    centre = mechanism.point_by_pose(x, np.zeros(3))[:, 2]
    payload = mechanism.point_by_pose(x, at.payload_centre)[:, 2]
    return np.asarray(FREE_FALL * (own * centre + at.payload[:, None] * payload))


def weight_known(robot: Robot, mechanism: Mechanism, at: Conditions, x: Array) -> Array:
    """`weight`, with an unknown payload taken as zero."""
    payload, centre = np.nan_to_num(at.payload), np.nan_to_num(at.payload_centre)
    return weight(robot, mechanism, replace(at, payload=payload, payload_centre=centre), x)
