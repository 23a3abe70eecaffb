"""Tree of a cable robot."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.look import Look
from delta_calibration.description.parts import Parts, motor, plate
from delta_calibration.description.skeleton import Strut
from delta_calibration.description.tree import (
    BASE,
    BLUE,
    ORANGE,
    TOOL,
    Cylinder,
    Link,
    Z,
    toward,
)
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import CableRobot, Mechanism
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_WIRE, _THICK = 0.004, 0.03  # [m] radii of cables and drums
_HALF = 0.03  # [m] half height of a drum
_BALL = 0.02  # [m] radius of a plate that shows a point platform


class CableRobotLook(Look):
    """Drums, cables and platform of a cable robot."""

    mechanism: ClassVar[str] = CableRobot.name

    def parts(self, robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
        """Drums that turn, and cables whose length is a joint of its own.

        If there are more cables than degrees of freedom, not all lengths fit a pose exactly: in
        the tree each cable reaches the platform, so its length differs by the closure residual
        from what its drum has let out.
        """
        assert isinstance(mechanism, CableRobot)
        home = mechanism.dimensions.home[None]
        # each row begins with the anchor and, if the platform is a body, the cable's joint on it
        cables = geometry.reshape(mechanism.joints, -1)
        anchors, body = cables[:, :3], mechanism.pose_size == 6
        ends = cables[:, 3:6] if body else mechanism.dimensions.joints
        ways = -mechanism.directions(home, geometry)[0]
        lengths = mechanism.lengths(home, geometry)[0].tolist()
        links, joints, struts = [], [], []
        for i, (anchor, way) in enumerate(zip(anchors, ways, strict=True)):
            drum = f"drum_{i + 1}"
            links.append(Link(drum, (Cylinder(-_HALF * Z, _HALF * Z, _THICK, ORANGE),)))
            joints.append(motor(robot, i, BASE, drum, Frame(np.eye(3), anchor), Z))
            origin = Frame(toward(-way), anchor)
            struts.append(
                Strut(str(i + 1), BASE, origin, ends[i], lengths[i], _WIRE, TOOL, True, BLUE)
            )
        top = float(np.abs(ends[:, 2]).max()) * Z
        width = float(np.linalg.norm(ends[:, :2], axis=1).max())
        platform = (Cylinder(-top, top, width),) if body else plate(_BALL)
        return Parts((), tuple(links), tuple(joints), tuple(struts), platform)
