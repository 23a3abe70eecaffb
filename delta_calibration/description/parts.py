"""Parts of a tree that depend on the mechanism, and helpers to make them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.skeleton import Follow, Strut
from delta_calibration.description.tree import PRISMATIC, REVOLUTE, Cylinder, Joint, Link, Z
from delta_calibration.geometry import Frame, rotations
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_HALF = 0.01 * Z  # [m] half thickness of a plate


@dataclass(frozen=True)
class Parts:
    """Links and joints from the base, struts to the platform, and links behind the platform.

    Without struts, `joints` contain the joint of the platform.
    """

    base: tuple[Cylinder, ...] = ()  # visible shapes of the base
    links: tuple[Link, ...] = ()
    joints: tuple[Joint, ...] = ()
    struts: tuple[Strut, ...] = ()
    platform: tuple[Cylinder, ...] = ()  # visible shapes of the platform
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
    """Make the tree joint of a motor joint, with its name and limits; its value is the reading.

    Args:
        robot: robot with the joint.
        index: index of the joint in the robot file.
        parent: link that the joint is mounted on.
        child: link that the joint moves.
        origin: frame of the child in the parent when the mechanism's own joint value is zero.
        axis: axis about or along which the mechanism's own joint value increases, (3,).
        kind: `REVOLUTE` or `PRISMATIC`.
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
    """A round plate perpendicular to z, with a radius [m]."""
    return (Cylinder(-_HALF, _HALF, radius),)
