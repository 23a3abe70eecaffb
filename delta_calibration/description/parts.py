"""What a mechanism's own part of a tree consists of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.skeleton import Follow, Strut
from delta_calibration.description.tree import PRISMATIC, REVOLUTE, Cylinder, Joint, Link, Z
from delta_calibration.geometry import Frame, rotations
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
    """The robot file's joint of this index, with its name and limits; its value is the reading.

    Args:
        robot: of which it is.
        index: of the joint.
        parent: link that it stands on.
        child: link that it moves.
        origin: of the child in the parent where the mechanism's own joint is zero.
        axis: about or along which its own joint grows, (3,).
        kind: of the joint.
    """
    own, drives = robot.joints, robot.drives
    limits = (float(own.lower[index]), float(own.upper[index]), own.speed)
    sense, unread = drives.sense[index], drives.sense[index] * -drives.zero[index] * axis
    if kind == PRISMATIC:
        origin = Frame(origin.rotation, origin.translation + origin.rotation @ unread)
    else:
        origin = Frame(origin.rotation @ rotations.exp(unread), origin.translation)
    return Joint(own.names[index], kind, parent, child, origin, sense * axis, *limits)


def plate(radius: float) -> tuple[Cylinder, ...]:
    """A round plate across z, of a radius [m]."""
    return (Cylinder(-_HALF, _HALF, radius),)
