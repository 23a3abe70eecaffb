"""A mechanism as a tree of links, with the values of its passive joints.

A tree has no loops, so only the first strut is connected to the platform and all others have free
ends. The values of the passive joints come from the mechanism's closure equations and place these
ends at the platform's joints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.tree import (
    CONTINUOUS,
    FIXED,
    GREY,
    PRISMATIC,
    TOOL,
    Colour,
    Cylinder,
    Joint,
    Link,
    Tree,
    X,
    Y,
    Z,
)
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism

Array = NDArray[np.float64]
Values = dict[str, Array]  # of joints, each (n,) [rad or m]
Follow = Callable[[Values, Array], Values]  # motor joints and pose (n, k) to dependent joints
Limb = tuple[tuple[Link, ...], tuple[Joint, ...]]

_LONGEST, _SPEED = 10.0, 100.0  # [length at home], [m/s] wide limits: URDF needs some for a cable
WRIST = ("platform_x", "platform_y", "platform_z")  # joints between first strut and platform
_WIRE = 0.6  # [length at home] drawn length of each half of a telescopic strut


@dataclass(frozen=True)
class Strut:
    """A rod or cable on a universal joint, from a link that the motors move to the platform.

    At zero swing and tilt it lies along -z of its origin; it swings about y, then tilts about x.
    """

    name: str
    link: str  # link where it begins
    origin: Frame  # frame of its beginning, in that link
    end: Array  # (3,) [m] position of its end, in `carrier`
    length: float  # [m]; of a cable the length at home
    radius: float  # [m]
    carrier: str = TOOL
    stretches: bool = False  # a cable, whose length is a joint as well
    colour: Colour = GREY

    @property
    def limb(self) -> Limb:
        """Links and joints of the strut: cross of the universal joint, strut, end of a cable."""
        cross, strut, end = (f"{part}_{self.name}" for part in ("cross", "strut", "end"))
        along = -(_WIRE if self.stretches else 1.0) * self.length * Z
        links = [Link(cross), Link(strut, (Cylinder(0 * Z, along, self.radius, self.colour),))]
        joints = [
            Joint(f"swing_{self.name}", CONTINUOUS, self.link, cross, self.origin, Y),
            Joint(f"tilt_{self.name}", CONTINUOUS, cross, strut, axis=X),
        ]
        if self.stretches:
            links.append(Link(end, (Cylinder(-along, 0 * Z, self.radius, self.colour),)))
            reach = (0.0, _LONGEST * self.length, _SPEED)
            joints.append(
                Joint(f"length_{self.name}", PRISMATIC, strut, end, Frame.identity(), -Z, *reach)
            )
        return tuple(links), tuple(joints)

    @property
    def tip(self) -> tuple[str, Frame]:
        """The link at the far end of the strut, and the frame of this end in that link."""
        if self.stretches:
            return f"end_{self.name}", Frame.identity()
        return f"strut_{self.name}", Frame(np.eye(3), -self.length * Z)


@dataclass(frozen=True)
class Skeleton:
    """A mechanism with a geometry (p,) and its tree.

    `follow` computes, from the motors' joints and the pose, joints that only some mechanisms have.
    """

    mechanism: Mechanism
    geometry: Array  # (p,)
    tree: Tree
    actuated: tuple[str, ...]  # (m,) motor joints of the tree, in the order of the robot file
    struts: tuple[Strut, ...] = ()  # the first one carries the platform
    wrist: Array = field(default_factory=lambda: np.eye(3))  # see `on_strut`
    follow: Follow = lambda values, pose: {}

    @property
    def passive(self) -> tuple[str, ...]:
        """Names of the passive joints."""
        return tuple(name for name in self.tree.moving if name not in self.actuated)

    def values(self, q: Array) -> Values:
        """Values (n,) of all joints at motor joints (n, m) [rad or m]; NaN if out of reach."""
        values = dict(zip(self.actuated, q.T, strict=True))
        if not self.struts:
            return values
        pose = self.mechanism.forward(q, self.geometry)
        values |= self.follow(values, pose)
        centre, turn = self.mechanism.position(pose), self.mechanism.rotation(pose)
        frames = self.tree.frames(values)
        for strut in self.struts:
            end = (turn @ self._on_platform(strut, values) @ strut.end[:, None])[..., 0]
            values |= aim(strut, frames[strut.link], centre + end)
        held = lying(self.struts[0], frames[self.struts[0].link][0], values)
        free = np.swapaxes(held @ self.wrist, 1, 2) @ turn
        return values | dict(zip(WRIST, turns_about_xyz(free), strict=True))

    def _on_platform(self, strut: Strut, values: Values) -> Array:
        """Rotation of a strut's carrier in the platform, (n, 3, 3) or (3, 3)."""
        if strut.carrier == TOOL:
            return np.eye(3)
        joint = next(joint for joint in self.tree.joints if joint.child == strut.carrier)
        return rotations.exp(values[joint.name][:, None] * joint.axis)


def on_strut(strut: Strut, turn: Array) -> Limb:
    """Connect the platform to a strut's end by a ball joint, made of three revolute joints.

    Args:
        strut: strut that carries the platform.
        turn: rotation of the platform in the strut's frame at home, (3, 3), where the three
            joints are at 0.
    """
    tip, at = strut.tip
    inner = ("wrist_x", "wrist_y", "wrist_z")
    starts = (Frame(turn, at.translation), Frame.identity(), Frame.identity())
    ways = zip(WRIST, (tip, *inner[:2]), inner, starts, (X, Y, Z), strict=True)
    joints = tuple(Joint(n, CONTINUOUS, p, c, start, axis) for n, p, c, start, axis in ways)
    centre = Joint("platform", FIXED, inner[2], TOOL, Frame(np.eye(3), -strut.end))
    return tuple(Link(name) for name in inner), (*joints, centre)


def aim(strut: Strut, link: tuple[Array, Array], end: Array) -> Values:
    """Swing, tilt and (of a cable) length with which a strut reaches `end`, (n, 3) [m]."""
    rotation, place = link
    start = place + rotation @ strut.origin.translation
    way = np.einsum("nji,nj->ni", rotation @ strut.origin.rotation, end - start)
    reach = np.linalg.norm(way, axis=1)
    values = {
        f"swing_{strut.name}": np.arctan2(-way[:, 0], -way[:, 2]),
        f"tilt_{strut.name}": np.arcsin(way[:, 1] / reach),
    }
    return values | ({f"length_{strut.name}": reach} if strut.stretches else {})


def lying(strut: Strut, link: Array, values: Values) -> Array:
    """Rotation of a strut in the base, (n, 3, 3), from that of its link (n, 3, 3)."""
    swing, tilt = (values[f"{way}_{strut.name}"][:, None] for way in ("swing", "tilt"))
    return np.asarray(
        link @ strut.origin.rotation @ rotations.exp(swing * Y) @ rotations.exp(tilt * X)
    )


def turns_about_xyz(rotation: Array) -> tuple[Array, Array, Array]:
    """Angles a, b, c, each (n,) [rad], of rotations R_x(a) R_y(b) R_z(c) (n, 3, 3)."""
    m = rotation
    level = np.hypot(m[:, 0, 0], m[:, 0, 1])
    return (
        np.arctan2(-m[:, 1, 2], m[:, 2, 2]),
        np.arctan2(m[:, 0, 2], level),
        np.arctan2(-m[:, 0, 1], m[:, 0, 0]),
    )
