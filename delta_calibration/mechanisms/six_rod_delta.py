"""Rotary Delta with its six rods: unequal rods and crooked ball joints tilt the platform."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.geometry import rotations
from delta_calibration.mechanisms.delta_leg import (
    LEG_FRAMES,
    LEGS,
    DeltaDimensions,
    DeltaModel,
    DeltaTolerances,
    arm_direction,
    arm_turn,
    tilt_vector,
    to_base,
)
from delta_calibration.mechanisms.rotary_delta import RotaryDelta, legs, on_diagonal
from delta_calibration.parameters import Parameter

Array = NDArray[np.float64]

_SIZE = 20  # parameters a leg
BASE, PLATFORM = slice(0, 3), slice(3, 6)  # radial, tangential, height
TILT_X, TILT_Z, ZERO, ARM, ROD, MISMATCH = 6, 7, 8, 9, 10, 11
ELBOW, JOINT = slice(12, 14), slice(14, 16)  # one of each a side
ELBOW_X, ELBOW_Z, LINE_X, LINE_Z = 16, 17, 18, 19
SIDE = np.array([-1.0, 1.0])  # which side of the leg's middle a rod is on, along the motor's axis
_ALONG = np.array([0.0, 1.0, 0.0])


class SixRodDelta(DeltaModel):
    """Three legs of two rods each; the platform has six coordinates, three of them commanded.

    Closure of rod j of leg i (paper 000 (5)): |p + R(w) a_ij - e_ij(q_i)|^2 = l_ij^2 with

        e_ij = Z_i (b_i + T_i (u(q_i + z_i) L_i + s_j c_ij n(elbow tilt))),
        a_ij = Z_i (a_i + s_j d_ij n(line tilt)).

    Pose x (n, 6): centre p [m], rotation vector w [rad]. Parameters of a leg, shape (60,) in all:
    base and platform joint (radial, tangential, height) [m], hinge tilt x, z [rad], joint zero z
    [rad], arm L [m], rod l (mean of the pair) and mismatch m [m] with l_ij = l_i + s_j m_i / 2,
    half widths c_1, c_2 at the elbow and d_1, d_2 at the platform [m], tilt x, z [rad] of the line
    of ball joints at the elbow (n in the hinge's frame, as the paper has it) and at the platform.

    36 combinations of the 60 show in the pose and 33 in the positions alone, at first order about
    the drawing. Leaves out a tilt of the elbow's line that turns with the arm, and clearance.
    """

    name: ClassVar[str] = "six_rod_delta"
    pose_size: int = 6

    def __init__(self, dimensions: DeltaDimensions, tolerances: DeltaTolerances) -> None:
        """From the drawing and the expected errors of the parts."""
        super().__init__(dimensions, tolerances)
        self._spheres = RotaryDelta(dimensions, tolerances)

    def closure(self, q: Array, x: Array, g: Array) -> Array:
        """Squared length of each rod less what it should be, (n, 6) [m^2]."""
        leg = legs(g)
        return _gap(self._rods(q, x, leg), leg)

    def closure_by_pose(self, q: Array, x: Array, g: Array) -> Array:
        """2 [s, s . d(R a)/dw], (n, 6, 6)."""
        leg = legs(g)
        return self._by_pose(self._rods(q, x, leg), x, leg)

    def linearised(self, q: Array, x: Array, g: Array) -> tuple[Array, Array]:
        """Both from the same rods."""
        leg = legs(g)
        s = self._rods(q, x, leg)
        return _gap(s, leg), self._by_pose(s, x, leg)

    def closure_by_joints(self, q: Array, x: Array, g: Array) -> Array:
        """Each joint moves the two elbow balls of its own leg, (n, 6, 3)."""
        leg = legs(g)
        turn = leg[..., ARM, None] * arm_turn(q + leg[..., ZERO])
        turn = to_base((rotations.exp(_hinge_tilt(leg)) @ turn[..., None])[..., 0])
        block = -2 * np.einsum("ncsi,nci->ncs", self._rods(q, x, leg), turn)
        return on_diagonal(block[..., None]).reshape(len(q), 2 * LEGS, LEGS)

    def closure_by_geometry(self, q: Array, x: Array, g: Array) -> Array:
        """df/dg, (n, 6, 60): blocks of twenty columns on the diagonal."""
        leg = legs(g)
        angle = q + leg[..., ZERO]
        s = self._rods(q, x, leg)
        in_leg = s @ LEG_FRAMES  # v @ R is R^T v: the same vector seen from the turned frame
        in_hinge = in_leg @ rotations.exp(_hinge_tilt(leg))
        in_platform = s @ rotations.exp(x[:, None, 3:]) @ LEG_FRAMES
        line, crooked = _line(_elbow_tilt(leg)), _line(_line_tilt(leg))
        line_turn, crooked_turn = _line_turn(_elbow_tilt(leg)), _line_turn(_line_tilt(leg))
        width, spread = (SIDE * leg[..., ELBOW])[..., None], (SIDE * leg[..., JOINT])[..., None]
        ball = leg[..., None, ARM, None] * arm_direction(angle)[..., None, :] + width * line
        tilt = rotations.exp_times_derivative(_hinge_tilt(leg)[..., None, :], ball)
        turn = leg[..., ARM, None] * arm_turn(angle)
        own = np.eye(2)  # what belongs to one rod of the pair only

        f = np.empty((*in_leg.shape[:3], _SIZE))
        f[..., BASE] = -2 * in_leg
        f[..., PLATFORM] = 2 * in_platform
        f[..., [TILT_X, TILT_Z]] = -2 * (in_leg[..., None, :] @ tilt)[..., 0, [0, 2]]
        f[..., ZERO] = -2 * _dot(in_hinge, turn[..., None, :])
        f[..., ARM] = -2 * _dot(in_hinge, arm_direction(angle)[..., None, :])
        f[..., ROD] = -2 * _lengths(leg)
        f[..., MISMATCH] = -_lengths(leg) * SIDE
        f[..., ELBOW] = (-2 * SIDE * _dot(in_hinge, line))[..., None] * own
        f[..., JOINT] = (2 * SIDE * _dot(in_platform, crooked))[..., None] * own
        f[..., [ELBOW_X, ELBOW_Z]] = -2 * width * (in_hinge @ line_turn)
        f[..., [LINE_X, LINE_Z]] = 2 * spread * (in_platform @ crooked_turn)
        return on_diagonal(f).reshape(len(q), 2 * LEGS, LEGS * _SIZE)

    def start(self, q: Array, g: Array) -> Array:
        """Meeting point of the three spheres with the pairs' means, no tilt."""
        x = self._spheres.forward(q, self.three_spheres(g))
        return np.concatenate([x, np.zeros_like(x)], axis=-1)

    def start_joints(self, task: Array, g: Array) -> Array:
        """Joints of the three-sphere model with the pairs' means."""
        return self._spheres.inverse(task, self.three_spheres(g))

    def three_spheres(self, g: Array) -> Array:
        """Nearest `RotaryDelta` geometry: hinge less platform joint.  (..., 60) -> (..., 24)."""
        leg = legs(g)
        joint = leg[..., BASE] - leg[..., PLATFORM]
        each = np.concatenate([joint, leg[..., TILT_X : ROD + 1]], axis=-1)
        return each.reshape((*g.shape[:-1], LEGS * 8))

    def _leg_parameters(self, leg: int) -> list[Parameter]:
        d, t = self.dimensions, self.tolerances
        where = f"joint_{leg}"

        def parameter(name: str, unit: str, nominal: float, prior: float, cause: str) -> Parameter:
            return Parameter(f"{name}_{leg}", unit, nominal, prior, cause, where)

        def place(part: str, radius: float) -> list[Parameter]:
            nominal = {"radial": radius, "tangential": 0.0, "height": 0.0}
            return [
                parameter(f"{part}_{axis}", "m", value, t.joint_position, "base_joint_position")
                for axis, value in nominal.items()
            ]

        def pair(part: str, nominal: float, prior: float, cause: str) -> list[Parameter]:
            names = (f"{part}_{leg}{side}" for side in "ab")
            return [Parameter(name, "m", nominal, prior, cause, where) for name in names]

        def tilt(part: str, prior: float, cause: str) -> list[Parameter]:
            return [parameter(f"{part}_tilt_{axis}", "rad", 0.0, prior, cause) for axis in "xz"]

        return [
            *place("base", d.base_radius),
            *place("platform", d.platform_radius),
            *tilt("hinge", t.hinge_tilt, "base_joint_tilt"),
            parameter("joint_zero", "rad", 0.0, t.joint_zero, "joint_zero_offset"),
            parameter("arm", "m", d.arm, t.arm, "arm_length"),
            parameter("rod", "m", d.rod, t.rod, "forearm_length"),
            parameter("rod_mismatch", "m", 0.0, t.rod_mismatch, "parallelogram_mismatch"),
            *pair("elbow_half_width", d.half_width, t.half_width, "parallelogram_mismatch"),
            *pair("platform_half_width", d.half_width, t.half_width, "parallelogram_mismatch"),
            *tilt("elbow_line", t.line_tilt, "parallelogram_mismatch"),
            *tilt("platform_line", t.line_tilt, "parallelogram_mismatch"),
        ]

    def _elbow_balls(self, q: Array, leg: Array) -> Array:
        """(n, 3 legs, 2 sides, 3) [m] in the base."""
        arm = leg[..., ARM, None] * arm_direction(q + leg[..., ZERO])
        width = (SIDE * leg[..., ELBOW])[..., None]
        balls = arm[..., None, :] + width * _line(_elbow_tilt(leg))
        turned = balls @ _transposed(rotations.exp(_hinge_tilt(leg)))
        return to_base(leg[..., None, BASE] + turned)

    def _platform_balls(self, leg: Array) -> Array:
        """(3 legs, 2 sides, 3) or (n, 3, 2, 3) [m] in the platform."""
        spread = (SIDE * leg[..., JOINT])[..., None]
        balls = leg[..., None, PLATFORM] + spread * _line(_line_tilt(leg))
        return balls @ _transposed(LEG_FRAMES)

    def _rods(self, q: Array, x: Array, leg: Array) -> Array:
        """s: from elbow to platform, (n, 3 legs, 2 sides, 3) [m] in the base."""
        turned = self._platform_balls(leg) @ _transposed(rotations.exp(x[:, None, 3:]))
        return x[:, None, None, :3] + turned - self._elbow_balls(q, leg)

    def _by_pose(self, s: Array, x: Array, leg: Array) -> Array:
        """2 [s, s . d(R a)/dw] with s . d(R a)/dw = (a x R^T s)^T J_r, J_r(w) = J_l(-w)."""
        turn = x[:, None, 3:]
        lever = np.cross(self._platform_balls(leg), s @ rotations.exp(turn))
        by_turn = lever @ rotations.left_jacobian(-turn)
        return 2 * np.concatenate([s, by_turn], axis=-1).reshape(len(x), 2 * LEGS, 6)


def _gap(s: Array, leg: Array) -> Array:
    """Squared lengths of the rods s less what they should be, (n, 6) [m^2]."""
    gap = np.sum(s**2, axis=-1) - _lengths(leg) ** 2
    return np.asarray(gap.reshape(len(s), 2 * LEGS))


def alike(spheres: RotaryDelta, g: Array) -> tuple[SixRodDelta, Array]:
    """Six rods in pairs that do not differ, that stand where three spheres do.  (24,) -> (60,)."""
    model = SixRodDelta(spheres.dimensions, spheres.tolerances)
    leg, known = legs(model.parameters.nominal.copy()), legs(g)
    leg[:, BASE] = known[:, :3] + leg[:, PLATFORM]
    leg[:, TILT_X : ROD + 1] = known[:, 3:]
    leg[:, [ELBOW_X, ELBOW_Z]] = -leg[:, [TILT_X, TILT_Z]]  # the pairs stay parallel
    return model, leg.reshape(-1)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def _lengths(leg: Array) -> Array:
    """Of the two rods of each leg.  (..., 3, 20) -> (..., 3, 2) [m]."""
    return leg[..., ROD, None] + SIDE * leg[..., MISMATCH, None] / 2


def _transposed(matrix: Array) -> Array:
    return np.swapaxes(matrix, -1, -2)


def _line(tilt: Array) -> Array:
    """Direction of a line of ball joints.  (..., 3) -> (..., 1, 3)."""
    return np.asarray((rotations.exp(tilt) @ _ALONG)[..., None, :])


def _line_turn(tilt: Array) -> Array:
    """Its derivative by the tilts about x and z.  (..., 3) -> (..., 3, 2)."""
    return rotations.exp_times_derivative(tilt, _ALONG)[..., [0, 2]]


def _hinge_tilt(leg: Array) -> Array:
    return tilt_vector(leg[..., TILT_X], leg[..., TILT_Z])


def _elbow_tilt(leg: Array) -> Array:
    return tilt_vector(leg[..., ELBOW_X], leg[..., ELBOW_Z])


def _line_tilt(leg: Array) -> Array:
    return tilt_vector(leg[..., LINE_X], leg[..., LINE_Z])
