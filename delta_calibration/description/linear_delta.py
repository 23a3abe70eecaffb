"""Tree of a linear Delta: a Delta with carriages on towers."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.look import Look
from delta_calibration.description.parts import Parts, motor, plate
from delta_calibration.description.skeleton import Strut
from delta_calibration.description.tree import (
    BASE,
    BLACK,
    BLUE,
    ORANGE,
    PRISMATIC,
    Cylinder,
    Link,
    X,
    Y,
    Z,
)
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import LinearDelta, Mechanism
from delta_calibration.mechanisms.linear_delta import ANGLE, ARM, ASIDE, ENDSTOP, OUT, RADIUS
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_THICK, _THIN = 0.02, 0.007  # [m] radii of carriages and arms
_HALF = 0.02 * Z  # [m] half height of a carriage


class LinearDeltaLook(Look):
    """Towers, carriages, arms and platform of a linear Delta."""

    mechanism: ClassVar[str] = LinearDelta.name

    def parts(self, robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
        """Carriages on towers with an arm each; arm joints are moved in by the platform radius."""
        links, joints, struts, towers = [], [], [], []
        for i, limb in enumerate(mechanism.limbs):
            g = np.append(geometry, mechanism.fixed)[list(limb.dimensions)]
            carriage, turn = f"carriage_{i + 1}", rotations.about_z(g[ANGLE])
            top = g[RADIUS] * turn[:, 0] + g[ENDSTOP] * Z
            lean = rotations.exp(_lean(float(g[OUT]), float(g[ASIDE])))
            start = Frame(turn @ lean, top)
            links.append(Link(carriage, (Cylinder(-_HALF, _HALF, _THICK, ORANGE),)))
            joints.append(motor(robot, i, BASE, carriage, start, -Z, PRISMATIC))
            arm = float(g[ARM])
            struts.append(
                Strut(str(i + 1), carriage, Frame.identity(), np.zeros(3), arm, _THIN, colour=BLUE)
            )
            towers.append(Cylinder(top * (X + Y), top, _THIN, BLACK))
        platform = plate(float(g[RADIUS]) / 4)
        return Parts(tuple(towers), tuple(links), tuple(joints), tuple(struts), platform)


def _lean(out: float, aside: float) -> Array:
    """Rotation vector (3,) of a tower that leans by the tangents `out` to x, `aside` to y."""
    across = np.hypot(out, aside)
    if across == 0.0:
        return np.zeros(3)
    return np.asarray(np.arctan(across) / across * np.array([-aside, out, 0.0]))
