"""Make the tree of a robot from its nominal or identified geometry."""

from __future__ import annotations

from itertools import chain

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.description.looks import LOOKS
from delta_calibration.description.parts import Parts
from delta_calibration.description.skeleton import Skeleton, on_strut
from delta_calibration.description.tree import (
    BASE,
    FIXED,
    GREY,
    TOOL,
    TRACKER,
    Cylinder,
    Joint,
    Link,
    Tree,
)
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_TIP = 0.004  # [m] radius of the rod from the platform to the tool centre point


def describe(robot: Robot, calibration: Calibration | None = None) -> Skeleton:
    """Make the tree of a robot with nominal or identified geometry; effects are not shown.

    With a calibration the tracker's frame is an additional link, fixed to the base.

    Raises:
        InputError: the mechanism is of another package, which adds no look for it.
    """
    if calibration is None:
        mechanism = robot.detailed
        geometry = mechanism.parameters.nominal
    else:
        mechanism, geometry = calibration.chain.mechanism, calibration.geometry
    if mechanism.name not in LOOKS:
        raise InputError(
            f"robot {robot.name}: no drawing is known for a {mechanism.name}, so its URDF has to "
            f"be written by hand; known: {', '.join(sorted(LOOKS))}"
        )
    look = LOOKS[mechanism.name]()
    mechanism, geometry = look.model(mechanism, geometry)
    parts = look.parts(robot, mechanism, geometry)
    more = _beyond(robot, calibration)
    return assembled(robot, mechanism, geometry, parts, more)


def assembled(
    robot: Robot, mechanism: Mechanism, geometry: Array, parts: Parts, more: Parts
) -> Skeleton:
    """Assemble the whole tree; the platform's ball joint is at zero with the motors at home."""
    limbs = [strut.limb for strut in parts.struts]
    links = (Link(BASE, parts.base), *parts.links, *chain.from_iterable(part for part, _ in limbs))
    joints = (*parts.joints, *chain.from_iterable(part for _, part in limbs))
    names = robot.joints.names

    def skeleton(wrist: Array) -> Skeleton:
        held, on = on_strut(parts.struts[0], wrist) if parts.struts else ((), ())
        every = (*links, *held, Link(TOOL, parts.platform), *parts.behind_links, *more.links)
        tree = Tree(robot.name, every, (*joints, *on, *parts.behind_joints, *more.joints))
        return Skeleton(mechanism, geometry, tree, names, parts.struts, wrist, parts.follow)

    free = skeleton(np.eye(3))
    if not parts.struts:
        return free
    frames = free.tree.frames(free.values(mechanism.home[None]))
    return skeleton(frames[parts.struts[0].tip[0]][0][0].T @ frames[TOOL][0][0])


def _beyond(robot: Robot, calibration: Calibration | None) -> Parts:
    """Links of the tool centre point, if off the platform's centre, and of a known tracker."""
    links, joints = [], []
    if robot.tool_offset.any():
        links.append(Link("tcp", (Cylinder(-robot.tool_offset, np.zeros(3), _TIP, GREY),)))
        joints.append(Joint("tcp", FIXED, TOOL, "tcp", Frame(np.eye(3), robot.tool_offset)))
    if calibration is not None:
        links.append(Link(TRACKER))
        joints.append(Joint(TRACKER, FIXED, BASE, TRACKER, calibration.frame.inverse()))
    return Parts(links=tuple(links), joints=tuple(joints))
