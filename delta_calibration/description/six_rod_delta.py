"""Tree of a rotary Delta with six rods."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.look import Look
from delta_calibration.description.parts import Parts, motor, plate
from delta_calibration.description.skeleton import Strut, Values
from delta_calibration.description.tree import (
    BASE,
    BLACK,
    BLUE,
    CONTINUOUS,
    ORANGE,
    Cylinder,
    Joint,
    Link,
    X,
    Y,
)
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism, SixRodDelta
from delta_calibration.mechanisms import six_rod_delta as delta
from delta_calibration.mechanisms.delta_leg import LEGS
from delta_calibration.mechanisms.rotary_delta import legs
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_THICK, _THIN = 0.02, 0.007  # [m] radii of arms and rods


class SixRodDeltaLook(Look):
    """Arms, rods and platform of a Delta."""

    mechanism: ClassVar[str] = SixRodDelta.name

    def parts(self, robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
        """Arms on hinges and six rods.

        An elbow is turned back by the arm's angle, tilted in the hinge's frame, and turned on
        again, because its line of ball joints has a tilt of either kind.
        """
        assert isinstance(mechanism, SixRodDelta)
        links: list[Link] = []
        joints: list[Joint] = []
        struts: list[Strut] = []
        stands = mechanism.dimensions.frames
        for stand, leg, number in zip(stands, legs(geometry), range(1, LEGS + 1), strict=True):
            arm, upright, elbow = f"arm_{number}", f"upright_{number}", f"elbow_{number}"
            zero = _about(Y, leg[delta.ZERO])
            hinge = stand @ _tilted(leg[delta.TILT_X], leg[delta.TILT_Z])
            kept = _tilted(leg[delta.ELBOW_X], leg[delta.ELBOW_Z])
            place = stand @ leg[delta.BASE]
            width = Y * float(leg[delta.ELBOW].max())
            along = X * float(leg[delta.ARM])
            links += [
                Link(arm, (Cylinder(0 * X, along, _THICK, ORANGE),)),
                Link(upright),
                Link(elbow, (Cylinder(-width, width, _THIN, BLACK),)),
            ]
            joints += [
                motor(robot, number - 1, BASE, arm, Frame(hinge @ zero, place), Y),
                Joint(upright, CONTINUOUS, arm, upright, Frame(zero.T, along), Y),
                Joint(elbow, CONTINUOUS, upright, elbow, Frame(kept @ zero, 0 * X), Y),
            ]
            struts += _rods(number, leg, elbow, stand)
        drawn = robot.dimensions
        return Parts(
            plate(drawn.base_radius),
            tuple(links),
            tuple(joints),
            tuple(struts),
            plate(drawn.platform_radius),
            follow=lambda values, pose: _upright(values, robot, mechanism),
        )


def _rods(number: int, leg: Array, elbow: str, stand: Array) -> list[Strut]:
    """The two rods of a leg; `stand` (3, 3) is the rotation of the leg's frame in the base."""
    line = _tilted(leg[delta.ON_ARM_X], leg[delta.ON_ARM_Z]) @ Y
    crooked = _tilted(leg[delta.LINE_X], leg[delta.LINE_Z]) @ Y
    rods = []
    for side, letter in enumerate("ab"):
        sign = delta.SIDE[side]
        start = sign * leg[delta.ELBOW][side] * line
        end = leg[delta.PLATFORM] + sign * leg[delta.JOINT][side] * crooked
        length = float(leg[delta.ROD] + sign * leg[delta.MISMATCH] / 2)
        origin = Frame(np.eye(3), start)
        name = f"{number}{letter}"
        rods.append(Strut(name, elbow, origin, stand @ end, length, _THIN, colour=BLUE))
    return rods


def _upright(values: Values, robot: Robot, mechanism: Mechanism) -> Values:
    """Turn the elbows back by the angles of the arms, and on again."""
    own = mechanism.drives.own(np.stack([values[name] for name in robot.joints.names], axis=-1))
    parts = {"upright": -own, "elbow": own}
    return {f"{part}_{n + 1}": by[..., n] for part, by in parts.items() for n in range(LEGS)}


def _tilted(about_x: Array, about_z: Array) -> Array:
    return rotations.exp(np.array([about_x, 0.0, about_z]))


def _about(axis: Array, angle: float) -> Array:
    return rotations.exp(axis * angle)
