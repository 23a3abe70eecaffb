"""Tree of a five-axis machine: sliders and struts of fixed length."""

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
from delta_calibration.mechanisms import FiveAxis, Mechanism
from delta_calibration.mechanisms.five_axis import (
    PLATFORM,
    SLIDER,
    STRUTS,
    TURNS_ABOUT_Y,
    by_strut,
)
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_ROD, _THICK = 0.012, 0.03  # [m] radii of struts and sliders
_HALF = 0.03  # [m] half height of a slider
_FORK = "fork"  # part of the platform that turns about x but not about y


class FiveAxisLook(Look):
    """Columns, sliders, struts and platform of a five-axis machine."""

    mechanism: ClassVar[str] = FiveAxis.name

    def parts(self, robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
        """Sliders and struts; two struts end in a fork that does not turn about y."""
        assert isinstance(mechanism, FiveAxis)
        model = mechanism
        read = model.home[None]
        at_home = model.position(model.forward(read, model.parameters.nominal))[0]
        home, limits = model.drives.own(read), np.stack([robot.joints.lower, robot.joints.upper])
        highest = model.drives.own(limits).max(axis=0)
        strut, lengths = by_strut(geometry)
        links, joints, struts, columns = [], [], [], []
        for i in range(STRUTS):
            slider, foot = f"slider_{i + 1}", strut[i, SLIDER]
            links.append(Link(slider, (Cylinder(-_HALF * Z, _HALF * Z, _THICK, ORANGE),)))
            joints.append(motor(robot, i, BASE, slider, Frame(np.eye(3), foot), Z, PRISMATIC))
            end, length = strut[i, PLATFORM], float(lengths[i])
            way = at_home + end - foot - home[0, i] * Z
            origin = Frame(toward(-way), np.zeros(3))
            carrier = TOOL if TURNS_ABOUT_Y[i] else _FORK
            struts.append(
                Strut(str(i + 1), slider, origin, end, length, _ROD, carrier, colour=BLUE)
            )
            top = foot + float(highest[i]) * Z
            columns.append(Cylinder(foot, top, _ROD / 2, BLACK))
        fork = abs(strut[2:, PLATFORM][:, 1]).max()
        rise = strut[2:, PLATFORM][:, 2].mean() * Z
        return Parts(
            tuple(columns),
            tuple(links),
            tuple(joints),
            tuple(struts),
            plate(float(np.linalg.norm(strut[0, PLATFORM][:2]))),
            (Link(_FORK, (Cylinder(rise - fork * Y, rise + fork * Y, _ROD, BLACK),)),),
            (Joint(_FORK, CONTINUOUS, TOOL, _FORK, axis=Y),),
            _unturned,
        )


def _unturned(values: Values, pose: Array) -> Values:
    """Turn the fork back about y by the angle of the platform; `pose` is (n, 4)."""
    return {_FORK: -pose[:, 3]}
