"""What the joints of a serial arm carry: links and payload, in motion and by their weight.

    tau_j = sum_k m_k J_kj . (a_k + g e_z)        J_kj = s_j x (c_k - o_j) for what joint j moves

with s_j, o_j the joint's axis, c_k a mass and a_k its acceleration. A link is a uniform rod from
its joint's axis to the next one's, or to the tool: a sixth of its mass at either end and the rest
in the middle have its mass, centre and inertia exactly. Evaluated on the nominal arm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects.loads import GRAVITY
from delta_calibration.mechanisms import SerialArm
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]

_STEP = 5e-3  # [s] over which the motion is differenced
_SHARES = np.array([1.0, 4.0, 1.0]) / 6  # of a rod's mass at start, middle and end (Simpson)


def joint_torque(arm: SerialArm, at: Conditions) -> Array:
    """Torque that each drive bears, (n, m) [N m]; NaN where the payload is not known."""
    walk = arm.walk(at.joint, arm.parameters.nominal)
    axis, origin = arm.joint_axes(walk)
    here, mass, link = _masses(arm, at.joint, at)
    there, back = (_masses(arm, _moved(at, t), at)[0] for t in (_STEP, -_STEP))
    pull = (there - 2 * here + back) / _STEP**2 + GRAVITY * np.array([0.0, 0.0, 1.0])
    force = mass[..., None] * pull
    torque = np.zeros(at.joint.shape)
    for j in range(arm.joints):
        moved = link >= j
        lever = np.cross(axis[:, None, j], here[:, moved] - origin[:, None, j])
        torque[:, j] = np.sum(lever * force[:, moved], axis=(1, 2))
    return torque


def _moved(at: Conditions, time: float) -> Array:
    return np.asarray(at.joint + at.velocity * time + at.acceleration * time**2 / 2)


def _masses(arm: SerialArm, joint: Array, at: Conditions) -> tuple[Array, Array, Array]:
    """Places (n, K, 3) [m] and sizes (n, K) [kg] of the masses, the joint each hangs on (K,)."""
    walk = arm.walk(joint, arm.parameters.nominal)
    _, origin = arm.joint_axes(walk)
    end = np.concatenate([origin[:, 1:], walk.position[:, None]], axis=1)
    rods = np.concatenate([origin, (origin + end) / 2, end], axis=1)
    load = walk.position + (walk.rotation @ at.payload_centre[..., None])[..., 0]
    own = np.outer(_SHARES, [link.mass for link in arm.dimensions.links]).ravel()
    size = np.column_stack([np.tile(own, (len(joint), 1)), at.payload])
    hangs = np.append(np.tile(np.arange(arm.joints), len(_SHARES)), arm.joints - 1)
    return np.concatenate([rods, load[:, None]], axis=1), size, hangs
