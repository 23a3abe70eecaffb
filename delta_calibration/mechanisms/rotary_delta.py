"""Rotary Delta as the intersection of three spheres: the platform only translates."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms.delta_leg import (
    LEGS,
    DeltaModel,
    elbow_of,
    hinge_frame,
    leg_frame,
    turned_on,
)
from delta_calibration.mechanisms.spheres import lower_meeting_point, way_round
from delta_calibration.model.symbols import (
    Symbol,
    acos,
    atan2,
    column,
    norm,
    square,
    wrapped,
)
from delta_calibration.parameters import Parameter

Array = NDArray[np.float64]

_SIZE = 8  # parameters per leg
RADIAL, TANGENTIAL, HEIGHT, TILT_X, TILT_Z, ZERO, ARM, ROD = range(_SIZE)


class RotaryDelta(DeltaModel):
    """Delta of three arms whose pairs of rods are equal: the platform keeps its orientation.

    Closure of leg i: |x - e_i(q_i)|^2 = l_i^2, e_i: elbow shifted inward by the platform radius,

        e_i = Z_i (b_i + T_i u(q_i + z_i) L_i).

    Parameters of a leg, shape (24,) in all: joint_radial, joint_tangential, joint_height [m] (b:
    hinge minus platform joint, paper 000's Delta e), hinge_tilt_x, hinge_tilt_z [rad] (T = exp of
    them), joint_zero z [rad], arm L [m], rod l [m] (mean of the pair). All 24 are identifiable
    from positions; six combinations of them are the rigid motion of the base, which is redundant
    with an unknown tracker frame.

    Leaves out the tilt of the platform by unequal rods: see `SixRodDelta`.
    """

    name: ClassVar[str] = "rotary_delta"
    pose_size: int = 3

    exact: ClassVar[bool] = True

    @staticmethod
    def equation(q: Symbol, x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """|x - e|^2 - l^2 of one leg [m^2]."""
        return square(x - elbow_of(*_arm(q, g, c))) - g[ROD] ** 2

    @staticmethod
    def opening(q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Lower intersection point of the three spheres about the elbows; closed form."""
        elbows = tuple(elbow_of(*_arm(q[leg], g[leg], c[leg])) for leg in range(LEGS))
        return lower_meeting_point(elbows, tuple(leg[ROD] for leg in g), _way_round(c))

    @staticmethod
    def nearby(
        d: Symbol, o: Symbol, x: Symbol, a: Symbol, q: Symbol, g: Symbol, c: Symbol
    ) -> Symbol:
        """Point o of the platform with the arms turned by small angles d from q."""
        del x, a
        elbows = tuple(turned_on(d[leg], *_arm(q[leg], g[leg], c[leg])) for leg in range(LEGS))
        return o + lower_meeting_point(elbows, tuple(leg[ROD] for leg in g), _way_round(c))

    @staticmethod
    def masses(x: Symbol, q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Positions of the platform, the elbows and the middles of the pairs of rods [m]."""
        elbows = [elbow_of(*_arm(q[leg], g[leg], c[leg])) for leg in range(LEGS)]
        return column(x[0:3], *elbows, *((elbow + x[0:3]) / 2 for elbow in elbows))

    @staticmethod
    def reaching(x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Joint angle, arm outward, in (-pi, pi]; closed form, paper 000 (2), (3)."""
        place = leg_frame(c).T @ x[0:3] - g[RADIAL : HEIGHT + 1]
        return outward(place, g[TILT_X : TILT_Z + 1], g[ZERO], g[ARM], g[ROD])

    def _leg_parameters(self, leg: int) -> list[Parameter]:
        d, t = self.dimensions, self.tolerances
        where, radius = f"joint_{leg}", d.base_radius - d.platform_radius
        # tolerances of hinge and platform joint together
        place = float(np.hypot(t.joint_position, t.joint_position))

        def parameter(name: str, unit: str, nominal: float, prior: float, cause: str) -> Parameter:
            return Parameter(f"{name}_{leg}", unit, nominal, prior, cause, where)

        return [
            parameter("joint_radial", "m", radius, place, "base_joint_position"),
            parameter("joint_tangential", "m", 0.0, place, "base_joint_position"),
            parameter("joint_height", "m", 0.0, place, "base_joint_position"),
            parameter("hinge_tilt_x", "rad", 0.0, t.hinge_tilt, "base_joint_tilt"),
            parameter("hinge_tilt_z", "rad", 0.0, t.hinge_tilt, "base_joint_tilt"),
            parameter("joint_zero", "rad", 0.0, t.joint_zero, "joint_zero_offset"),
            parameter("arm", "m", d.arm, t.arm, "arm_length"),
            parameter("rod", "m", d.rod, t.rod, "forearm_length"),
        ]


def _way_round(c: Symbol) -> Symbol:
    """Sense in which the legs are numbered about z: 1 counter-clockwise, -1 clockwise."""
    return way_round(tuple((leg[0], leg[1]) for leg in c))


def _arm(q: Symbol, g: Symbol, c: Symbol) -> tuple[Symbol, ...]:
    """Direction of a leg, its hinge, angle, tilt and arm length: arguments of `elbow_of`."""
    return c, g[RADIAL : HEIGHT + 1], q + g[ZERO], g[TILT_X : TILT_Z + 1], g[ARM]


def outward(place: Symbol, tilt: Symbol, zero: Symbol, arm: Symbol, rod: Symbol) -> Symbol:
    """Joint angle [rad] at which a leg reaches a place, its arm outward; NaN out of reach.

        L (w_x cos - w_z sin) = (|w|^2 + L^2 - l^2) / 2

    Args:
        place: position of the wrist relative to the hinge, in the leg's frame [m].
        tilt: tilt of the motor's axis about x and z [rad].
        zero: zero offset of the encoder [rad].
        arm: length of the upper arm [m].
        rod: length of the forearm [m].
    """
    wrist = hinge_frame(tilt).T @ place
    level = (square(wrist) + arm**2 - rod**2) / 2
    radius = arm * norm(column(wrist[0], wrist[2]))
    return wrapped(atan2(-wrist[2], wrist[0]) - acos(level / radius) - zero)


def legs(g: Array) -> Array:
    """Reshape the geometry by leg: (p,) or (n, p) -> (3, p / 3) or (n, 3, p / 3)."""
    return g.reshape((*g.shape[:-1], LEGS, g.shape[-1] // LEGS))
