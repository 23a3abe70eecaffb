"""Rotary Delta with six rods: unequal rods and misaligned ball joints tilt the platform."""

from __future__ import annotations

from dataclasses import replace
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
from delta_calibration.mechanisms.rotary_delta import RotaryDelta, legs
from delta_calibration.model.symbols import (
    Symbol,
    column,
    cos,
    little,
    rotation,
    sin,
    square,
    tilt,
)
from delta_calibration.parameters import Parameter

Array = NDArray[np.float64]

BASE, PLATFORM = slice(0, 3), slice(3, 6)  # radial, tangential, height
TILT_X, TILT_Z, ZERO, ARM, ROD, MISMATCH = 6, 7, 8, 9, 10, 11
ELBOW, JOINT = slice(12, 14), slice(14, 16)  # half widths, one per rod
ELBOW_X, ELBOW_Z, LINE_X, LINE_Z, ON_ARM_X, ON_ARM_Z = 16, 17, 18, 19, 20, 21
SIDE = (-1.0, 1.0)  # which side of the leg's middle a rod is on, along the motor's axis
_ALONG = (0.0, 1.0, 0.0)
_STEPS = 4  # from a nearby pose: the error is below 1e-11 m at `LITTLE` from the command


class SixRodDelta(DeltaModel):
    """Delta of three arms with six rods, each of its own length: the platform tilts a little.

    The platform has six coordinates, three of them commanded.

    Closure of rod j of leg i (paper 000 (5)): |p + R(w) a_ij - e_ij(q_i)|^2 = l_ij^2 with

        e_ij = Z_i (b_i + T_i (u(q_i + z_i) L_i + s_j c_ij E_i R_y(q_i + z_i) n(tilt on the arm))),
        a_ij = Z_i (a_i + s_j d_ij n(platform tilt)).

    Pose x (n, 6): centre p [m], rotation vector w [rad]. Parameters of a leg, shape (66,) in all:
    base and platform joint (radial, tangential, height) [m], hinge tilt x, z [rad], joint zero z
    [rad], arm L [m], rod l (mean of the pair) and mismatch m [m] with l_ij = l_i + s_j m_i / 2,
    half widths c_1, c_2 at the elbow and d_1, d_2 at the platform [m], and three tilts x, z [rad]
    of lines of ball joints: at the elbow in the hinge's frame (E, the paper's), at the platform,
    and at the elbow in the arm's frame, so that the line turns with the arm: its ball joints are
    mounted on the arm.

    Of the paper's 60, which are all but the last, 36 combinations are identifiable from poses and
    33 from positions alone, at first order about the drawing; with the last, 42 and 38. Leaves out
    clearance.
    """

    name: ClassVar[str] = "six_rod_delta"
    pose_size: int = 6

    @staticmethod
    def equation(q: Symbol, x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Squared length of the two rods of one leg, minus that of their parameters [m^2]."""
        angle = q + g[ZERO]
        line = _elbow_line(cos(angle), sin(angle), g, c)
        return _gaps(elbow_of(*_arm(q, g, c)), line, x[0:3], rotation(x[3:6]), g, c)

    @staticmethod
    def opening(q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Pose of the three-sphere model with each pair's mean dimensions, without tilt."""
        return column(RotaryDelta.opening(q, [_sphere(leg) for leg in g], c), 0, 0, 0)

    @staticmethod
    def nearby(
        d: Symbol, o: Symbol, x: Symbol, a: Symbol, q: Symbol, g: Symbol, c: Symbol
    ) -> Symbol:
        """Point o of the platform: moved by three spheres, then by Newton steps with f_x at x."""
        spheres = [_sphere(leg) for leg in g]
        on = RotaryDelta.nearby(d, x[0:3], x, a, q, spheres, c)
        on = column(on - RotaryDelta.opening(q, spheres, c), x[3:6])
        elbows = [turned_on(d[leg], *_arm(q[leg], g[leg], c[leg])) for leg in range(LEGS)]
        lines = [_line_turned_on(d[leg], q[leg], g[leg], c[leg]) for leg in range(LEGS)]
        for _ in range(_STEPS):
            turn = tilt(on[3:6])
            each = zip(elbows, lines, g, c, strict=True)
            gaps = (_gaps(elbow, line, on[0:3], turn, *own) for elbow, line, *own in each)
            on -= a @ column(*gaps)
        return on[0:3] + tilt(on[3:6]) @ o

    @staticmethod
    def masses(x: Symbol, q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Positions of the platform, the elbows and the middles of the pairs of rods [m]."""
        return RotaryDelta.masses(x, q, [_sphere(leg) for leg in g], c)

    @staticmethod
    def reaching(x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Joint angle of the three-sphere model with the pair's mean dimensions."""
        return RotaryDelta.reaching(x, _sphere(g), c)

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
            *(
                replace(each, drawn=False)
                for each in tilt("elbow_line_on_arm", t.line_tilt, "parallelogram_mismatch")
            ),
        ]


def alike(spheres: RotaryDelta, g: Array) -> tuple[SixRodDelta, Array]:
    """Six-rod model with equal rods that is equivalent to three spheres.  (24,) -> (66,)."""
    model = SixRodDelta(spheres.dimensions, spheres.tolerances).driven(spheres.drives)
    leg, known = legs(model.parameters.nominal.copy()), legs(g)
    leg[:, BASE] = known[:, :3] + leg[:, PLATFORM]
    leg[:, TILT_X : ROD + 1] = known[:, 3:]
    leg[:, [ELBOW_X, ELBOW_Z]] = -leg[:, [TILT_X, TILT_Z]]  # the pairs stay parallel
    return model, leg.reshape(-1)


def _arm(q: Symbol, g: Symbol, c: Symbol) -> tuple[Symbol, ...]:
    """Direction of a leg, its hinge, angle, tilt and arm length: arguments of `elbow_of`."""
    return c, g[BASE], q + g[ZERO], g[TILT_X : TILT_Z + 1], g[ARM]


def _elbow_line(cosine: Symbol, sine: Symbol, g: Symbol, c: Symbol) -> Symbol:
    """Direction of the line of ball joints at an elbow; cosine and sine of the arm's angle."""
    n = hinge_frame(g[ON_ARM_X : ON_ARM_Z + 1]) @ column(*_ALONG)
    line = column(cosine * n[0] + sine * n[2], n[1], cosine * n[2] - sine * n[0])
    hinge = hinge_frame(g[TILT_X : TILT_Z + 1]) @ hinge_frame(g[ELBOW_X : ELBOW_Z + 1])
    return leg_frame(c) @ hinge @ line


def _line_turned_on(d: Symbol, q: Symbol, g: Symbol, c: Symbol) -> Symbol:
    """The same line after the arm has turned by d [rad], up to `symbols.LITTLE`."""
    (ahead, across), angle = little(d), q + g[ZERO]
    cosine, sine = cos(angle), sin(angle)
    return _elbow_line(ahead * cosine - across * sine, ahead * sine + across * cosine, g, c)


def _gaps(
    elbow: Symbol, line: Symbol, centre: Symbol, turn: Symbol, g: Symbol, c: Symbol
) -> Symbol:
    """Squared length of the two rods of a leg, minus that of their parameters [m^2]."""
    stand = leg_frame(c)
    crooked = stand @ hinge_frame(g[LINE_X : LINE_Z + 1]) @ column(*_ALONG)
    gaps = []
    for rod, side in enumerate(SIDE):
        ball = stand @ g[PLATFORM] + side * g[JOINT][rod] * crooked
        s = centre - elbow + turn @ ball - side * g[ELBOW][rod] * line
        gaps.append(square(s) - (g[ROD] + side * g[MISMATCH] / 2) ** 2)
    return column(*gaps)


def _sphere(g: Symbol) -> Symbol:
    """Parameters of the equivalent `RotaryDelta` leg: hinge minus platform joint, and the rest."""
    return column(g[BASE] - g[PLATFORM], g[TILT_X : ROD + 1])
