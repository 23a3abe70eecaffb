"""Trees of machines on cables and on struts of fixed length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.parts import Parts, motor, plate
from delta_calibration.description.skeleton import Strut, Values
from delta_calibration.description.tree import (
    BASE,
    BLACK,
    BLUE,
    CONTINUOUS,
    ORANGE,
    PRISMATIC,
    TOOL,
    Cylinder,
    Joint,
    Link,
    Y,
    Z,
    toward,
)
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import CableRobot, FiveAxis, Mechanism
from delta_calibration.mechanisms.five_axis import PLATFORM, SLIDER, STRUTS, TURNS_ABOUT_Y
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_WIRE, _ROD, _THICK = 0.004, 0.012, 0.03  # [m] radii
_HALF = 0.03  # [m] of a slider or drum
_BALL = 0.02  # [m] radius of a platform that is a point
_FORK = "fork"  # the part of the five-axis platform that turns about x alone


def cable_robot(robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
    """Drums that turn, and cables whose length is a joint of its own.

    More cables than freedoms do not all fit a pose: each cable reaches the platform in the tree,
    and is by the misfit longer or shorter than what its drum has let out.
    """
    assert isinstance(mechanism, CableRobot)
    home = mechanism.dimensions.home[None]
    cables = geometry.reshape(mechanism.joints, -1)  # anchor, and of a body its own joint, first
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


def five_axis(robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
    """Sliders and struts; two struts end in a fork that does not turn about y."""
    assert isinstance(mechanism, FiveAxis)
    model = mechanism
    home = model.home[None]
    at_home = model.position(model.forward(home, model.parameters.nominal))[0]
    strut = geometry.reshape(STRUTS, -1)
    links, joints, struts, columns = [], [], [], []
    for i in range(STRUTS):
        slider, foot = f"slider_{i + 1}", strut[i, SLIDER]
        links.append(Link(slider, (Cylinder(-_HALF * Z, _HALF * Z, _THICK, ORANGE),)))
        joints.append(motor(robot, i, BASE, slider, Frame(np.eye(3), foot), Z, PRISMATIC))
        end, length = strut[i, PLATFORM], float(model.lengths[i])
        way = at_home + end - foot - home[0, i] * Z
        origin = Frame(toward(-way), np.zeros(3))
        carrier = TOOL if TURNS_ABOUT_Y[i] else _FORK
        struts.append(Strut(str(i + 1), slider, origin, end, length, _ROD, carrier, colour=BLUE))
        top = foot + float(robot.joints.upper[i]) * Z
        columns.append(Cylinder(foot, top, _ROD / 2, BLACK))
    fork = abs(strut[2:, PLATFORM][:, 1]).max()
    rise = strut[2:, PLATFORM][:, 2].mean() * Z
    return Parts(
        tuple(columns), tuple(links), tuple(joints), tuple(struts),
        plate(float(np.linalg.norm(strut[0, PLATFORM][:2]))),
        (Link(_FORK, (Cylinder(rise - fork * Y, rise + fork * Y, _ROD, BLACK),)),),
        (Joint(_FORK, CONTINUOUS, TOOL, _FORK, axis=Y),),
        _unturned,
    )  # fmt: skip


def _unturned(values: Values, pose: Array) -> Values:
    """The fork turns back about y by what the platform turns, (n, 4) pose."""
    return {_FORK: -pose[:, 3]}
