"""What a mechanism's own part of a tree consists of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.skeleton import Follow, Strut
from delta_calibration.description.tree import REVOLUTE, Cylinder, Joint, Link, Z
from delta_calibration.geometry import Frame
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_HALF = 0.01 * Z  # [m] of a plate's thickness


@dataclass(frozen=True)
class Parts:
    """Links and joints from the base on, struts to the platform, and what hangs on the platform.

    A mechanism without struts has the platform's joint among its own.
    """

    base: tuple[Cylinder, ...] = ()  # what is seen of the base
    links: tuple[Link, ...] = ()
    joints: tuple[Joint, ...] = ()
    struts: tuple[Strut, ...] = ()
    platform: tuple[Cylinder, ...] = ()  # what is seen of the platform
    behind_links: tuple[Link, ...] = ()
    behind_joints: tuple[Joint, ...] = ()
    follow: Follow = lambda values, pose: {}


def motor(
    robot: Robot,
    index: int,
    parent: str,
    child: str,
    origin: Frame,
    axis: Array,
    kind: str = REVOLUTE,
) -> Joint:
    """The robot file's joint of this index, with its name and limits."""
    own = robot.joints
    limits = (float(own.lower[index]), float(own.upper[index]), own.speed)
    return Joint(own.names[index], kind, parent, child, origin, axis, *limits)


def plate(radius: float) -> tuple[Cylinder, ...]:
    """A round plate across z, of a radius [m]."""
    return (Cylinder(-_HALF, _HALF, radius),)
