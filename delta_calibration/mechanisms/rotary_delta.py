"""Rotary Delta as the meeting of three spheres: the platform only translates."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.geometry import rotations
from delta_calibration.mechanisms.delta_leg import (
    LEGS,
    DeltaModel,
    arm_direction,
    arm_turn,
    tilt_vector,
    to_base,
    to_legs,
)
from delta_calibration.parameters import Parameter

Array = NDArray[np.float64]

_SIZE = 8  # parameters a leg
RADIAL, TANGENTIAL, HEIGHT, TILT_X, TILT_Z, ZERO, ARM, ROD = range(_SIZE)


class RotaryDelta(DeltaModel):
    """Three legs on motors, a platform that keeps its orientation.

    Closure of leg i: |x - e_i(q_i)|^2 = l_i^2, with e_i the elbow moved in by the platform radius,

        e_i = Z_i (b_i + T_i u(q_i + z_i) L_i).

    Parameters of a leg, shape (24,) in all: joint_radial, joint_tangential, joint_height [m] (b:
    hinge less platform joint, paper 000's Delta e), hinge_tilt_x, hinge_tilt_z [rad] (T = exp of
    them), joint_zero z [rad], arm L [m], rod l [m] (mean of the pair). All 24 show in the
    positions; six combinations of them are the rigid motion of the base, which an unknown tracker
    frame takes up.

    Leaves out the tilt of the platform by unequal rods: see `SixRodDelta`.
    """

    name: ClassVar[str] = "rotary_delta"
    pose_size: int = 3

    def closure(self, q: Array, x: Array, g: Array) -> Array:
        """|x - e_i|^2 - l_i^2, (n, 3) [m^2]."""
        rod = legs(g)[..., ROD]
        return np.asarray(np.sum(self._forearm(q, x, g) ** 2, axis=-1) - rod**2)

    def closure_by_pose(self, q: Array, x: Array, g: Array) -> Array:
        """2 (x - e_i), (n, 3, 3)."""
        return 2 * self._forearm(q, x, g)

    def closure_by_joints(self, q: Array, x: Array, g: Array) -> Array:
        """Diagonal: each joint moves its own elbow, (n, 3, 3)."""
        leg = legs(g)
        turn = _tilted(leg, leg[..., ARM, None] * arm_turn(q + leg[..., ZERO]))
        diagonal = -2 * np.sum(self._forearm(q, x, g) * turn, axis=-1)
        return np.asarray(diagonal[..., None] * np.eye(LEGS))

    def closure_by_geometry(self, q: Array, x: Array, g: Array) -> Array:
        """df/dg, (n, 3, 24): blocks of eight columns on the diagonal."""
        leg = legs(g)
        s = self._forearm(q, x, g)
        angle = q + leg[..., ZERO]
        arm = leg[..., ARM, None] * arm_direction(angle)
        tilt = rotations.exp_times_derivative(_tilt(leg), arm)
        columns = np.empty((*s.shape[:2], 3, _SIZE))
        axes = to_base(np.broadcast_to(np.eye(3), (*s.shape, 3)))
        columns[..., RADIAL : HEIGHT + 1] = axes.swapaxes(2, 3)
        columns[..., TILT_X] = to_base(tilt[..., 0])
        columns[..., TILT_Z] = to_base(tilt[..., 2])
        columns[..., ZERO] = _tilted(leg, leg[..., ARM, None] * arm_turn(angle))
        columns[..., ARM] = _tilted(leg, arm_direction(angle))
        columns[..., ROD] = 0.0
        block = -2 * np.einsum("nci,ncip->ncp", s, columns)
        block[..., ROD] = -2 * leg[..., ROD]
        return on_diagonal(block)

    def forward(self, q: Array, g: Array, guess: Array | None = None) -> Array:
        """Lower meeting point of the three spheres about the elbows, (n, 3) [m]; closed form.

        `guess` is not needed and not used.
        """
        leg = legs(g)
        elbow, rod = self._elbow(q, leg), np.broadcast_to(leg[..., ROD], q.shape)
        return lower_meeting_point(elbow, rod)

    def inverse(self, task: Array, g: Array, guess: Array | None = None) -> Array:
        """Joint angles, arms outward, (n, 3) [rad] in (-pi, pi]; closed form, paper 000 (2), (3).

        `guess` is not needed and not used.
        """
        leg = legs(g)
        wrist = to_legs(task) - leg[..., RADIAL : HEIGHT + 1]
        wrist = (wrist[..., None, :] @ rotations.exp(_tilt(leg)))[..., 0, :]  # v @ R is R^T v
        arm, rod = leg[..., ARM], leg[..., ROD]
        # L (w_x cos - w_z sin) = (|w|^2 + L^2 - l^2) / 2
        level = (np.sum(wrist**2, axis=-1) + arm**2 - rod**2) / 2
        radius = arm * np.hypot(wrist[..., 0], wrist[..., 2])
        toward = np.arctan2(-wrist[..., 2], wrist[..., 0])
        with np.errstate(invalid="ignore", divide="ignore"):
            opening = np.arccos(level / radius)  # NaN where the leg cannot reach
        angle = toward - opening - leg[..., ZERO]
        return np.asarray(np.pi - np.mod(np.pi - angle, 2 * np.pi))

    def start(self, q: Array, g: Array) -> Array:
        """The solution itself: the direct problem is closed."""
        return self.forward(q, g)

    def start_joints(self, task: Array, g: Array) -> Array:
        """The solution itself: the inverse problem is closed."""
        return self.inverse(task, g)

    def _leg_parameters(self, leg: int) -> list[Parameter]:
        d, t = self.dimensions, self.tolerances
        where, radius = f"joint_{leg}", d.base_radius - d.platform_radius
        # hinge and platform joint together
        place = float(np.hypot(t.joint_position, t.joint_position))

        def parameter(name: str, unit: str, nominal: float, prior: float, cause: str) -> Parameter:
            return Parameter(f"{name}_{leg}", unit, nominal, prior, cause, where)

        return [
            parameter("joint_radial", "m", radius, place, "base_joint_position"),
            parameter("joint_tangential", "m", 0.0, place, "base_joint_position"),
            parameter("joint_height", "m", 0.0, place, "base_joint_position"),
            parameter("hinge_tilt_x", "rad", 0.0, t.hinge_tilt, "base_joint_tilt"),
            parameter("hinge_tilt_z", "rad", 0.0, t.hinge_tilt, "base_joint_tilt"),
            parameter("joint_zero", "rad", 0.0, t.zero, "joint_zero_offset"),
            parameter("arm", "m", d.arm, t.arm, "arm_length"),
            parameter("rod", "m", d.rod, t.rod, "forearm_length"),
        ]

    def _elbow(self, q: Array, leg: Array) -> Array:
        angle = q + leg[..., ZERO]
        hinge = to_base(np.broadcast_to(leg[..., RADIAL : HEIGHT + 1], (*angle.shape, 3)))
        return hinge + _tilted(leg, leg[..., ARM, None] * arm_direction(angle))

    def _forearm(self, q: Array, x: Array, g: Array) -> Array:
        return x[:, None, :] - self._elbow(q, legs(g))


def legs(g: Array) -> Array:
    """Geometry by leg.  (p,) or (n, p) -> (3, 8) or (n, 3, 8)."""
    return g.reshape((*g.shape[:-1], LEGS, g.shape[-1] // LEGS))


def on_diagonal(block: Array) -> Array:
    """Each leg's derivatives in its own columns.  (n, 3, ..., s) -> (n, 3, ..., 3 s)."""
    n, count, size = block.shape[0], block.shape[1], block.shape[-1]
    wide = np.zeros((*block.shape[:-1], count * size), dtype=block.dtype)
    for leg in range(count):
        wide[:, leg, ..., leg * size : (leg + 1) * size] = block[:, leg]
    return wide.reshape((n, *wide.shape[1:]))


def lower_meeting_point(centre: Array, radius: Array) -> Array:
    """Where three spheres meet, the point on the far side of (c2 - c1) x (c3 - c1).

    For elbows at 0, 120 and 240 degrees that is the point under them.  (n, 3, 3), (n, 3) -> (n,
    3); NaN where they do not meet.
    """
    a, b = centre[:, 1] - centre[:, 0], centre[:, 2] - centre[:, 0]
    normal = np.cross(a, b)
    square = np.sum(normal**2, axis=-1, keepdims=True)
    r2 = radius**2
    da = (np.sum(a * a, axis=-1) + r2[:, 0] - r2[:, 1])[:, None] / 2
    db = (np.sum(b * b, axis=-1) + r2[:, 0] - r2[:, 2])[:, None] / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        foot = (da * np.cross(b, normal) + db * np.cross(normal, a)) / square
        height2 = (r2[:, :1] - np.sum(foot**2, axis=-1, keepdims=True)) / square
        return np.asarray(centre[:, 0] + foot - np.sqrt(height2) * normal)


def _tilt(leg: Array) -> Array:
    return tilt_vector(leg[..., TILT_X], leg[..., TILT_Z])


def _tilted(leg: Array, vectors: Array) -> Array:
    """Vectors of the true hinge frames in the base.  (n, 3, 3) -> (n, 3, 3)."""
    return to_base((rotations.exp(_tilt(leg)) @ vectors[..., None])[..., 0])
