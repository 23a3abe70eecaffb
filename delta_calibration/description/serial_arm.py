"""Tree of a serial arm."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.look import Look
from delta_calibration.description.parts import Parts, motor, plate
from delta_calibration.description.tree import (
    BASE,
    BLUE,
    FIXED,
    ORANGE,
    TOOL,
    Cylinder,
    Joint,
    Link,
    X,
    Y,
    Z,
)
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism, SerialArm
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_THICK, _BALL = 0.03, 0.015  # [m] radii of links and of the tool


class SerialArmLook(Look):
    """Links, joints and tool of an arm."""

    mechanism: ClassVar[str] = SerialArm.name

    def parts(self, robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
        """Links in modified DH form, A_i = R_x R_y T_x R_z(q_i + z_i) T_z.

        The offset (T_z) belongs to the link behind the joint.
        """
        assert isinstance(mechanism, SerialArm)
        given = dict(zip(mechanism.parameters.names, geometry.tolist(), strict=True))
        links, joints, parent = [], [], BASE
        rise = np.zeros(3)  # along the axis of the joint before
        seen: list[tuple[Cylinder, ...]] = []
        for i, drawn in enumerate(mechanism.dimensions.links, 1):
            turn = _about(X, given[f"twist_{i}"]) @ _about(Y, given.get(f"skew_{i}", 0.0))
            shift = rise + turn[:, 0] * given[f"length_{i}"]
            seen.append(_drawn(rise, shift))
            origin = Frame(turn @ _about(Z, given[f"zero_{i}"]), shift)
            joints.append(motor(robot, i - 1, parent, f"link_{i}", origin, Z))
            parent = f"link_{i}"
            rise = Z * given.get(f"offset_{i}", drawn.offset)
        end = rise + np.array([given[f"tool_{axis}"] for axis in "xyz"])
        mount = zip((Z, Y, X), mechanism.dimensions.mount.tolist(), strict=True)
        own = ((axis, given[f"tool_turn_{n}"]) for axis, n in zip((X, Y, Z), "xyz", strict=True))
        turn = np.eye(3)
        for axis, angle in (*mount, *own):
            turn = turn @ _about(axis, angle)
        joints.append(Joint("tool_mount", FIXED, parent, TOOL, Frame(turn, end)))
        seen.append(_drawn(rise, end))
        links = [Link(f"link_{i}", shapes) for i, shapes in enumerate(seen[1:], 1)]
        return Parts(seen[0], tuple(links), tuple(joints), platform=plate(_BALL))


def _drawn(corner: Array, end: Array) -> tuple[Cylinder, ...]:
    """Draw a link as two rods: along the axis it turns about, then to the next joint."""
    bends = ((np.zeros(3), corner, ORANGE), (corner, end, BLUE))
    return tuple(Cylinder(a, b, _THICK, c) for a, b, c in bends if not np.array_equal(a, b))


def _about(axis: Array, angle: float) -> Array:
    return rotations.exp(axis * angle)
