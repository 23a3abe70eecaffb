"""Tree of links and joints as in URDF, and its forward kinematics.

A joint's frame is at `origin` in its parent. The child's frame is the joint's frame, rotated about
`axis` or shifted along it by the joint's value.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame, rotations

Array = NDArray[np.float64]

BASE, TOOL, TRACKER = "base_link", "tool0", "tracker"  # public frame names
_PREFIX = re.compile(r"([\w.-]+(/[\w.-]+)*/?)?", re.ASCII)
FIXED, REVOLUTE, CONTINUOUS, PRISMATIC = "fixed", "revolute", "continuous", "prismatic"
X, Y, Z = np.eye(3)

# Okabe and Ito's palette, distinguishable by colour-blind people too; red, green, blue in 0..1.
GREY, BLACK = (0.6, 0.6, 0.6), (0.15, 0.15, 0.15)
ORANGE, BLUE = (0.90, 0.62, 0.0), (0.0, 0.45, 0.70)
GREEN = (0.0, 0.62, 0.45)
VERMILION, PURPLE = (0.84, 0.37, 0.0), (0.80, 0.47, 0.65)
Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Cylinder:
    """A cylinder of a link, between two points in the link's frame."""

    start: Array  # (3,) [m]
    end: Array  # (3,) [m]
    radius: float  # [m]
    colour: Colour = GREY


@dataclass(frozen=True)
class Link:
    """A body with its visible shapes."""

    name: str
    shapes: tuple[Cylinder, ...] = ()


@dataclass(frozen=True)
class Joint:
    """A joint from a parent link to a child link.

    The limits `lower` and `upper` [rad or m] and `speed` [rad/s or m/s] are only used if it is
    revolute or prismatic.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Frame = field(default_factory=Frame.identity)
    axis: Array = field(default_factory=lambda: Z)  # (3,) of length 1, in the joint's frame
    lower: float = 0.0
    upper: float = 0.0
    speed: float = 0.0


@dataclass(frozen=True)
class Tree:
    """A robot as a tree; each joint comes after the joint that leads to its parent."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    @property
    def moving(self) -> tuple[str, ...]:
        """Names of the joints that have a value."""
        return tuple(joint.name for joint in self.joints if joint.kind != FIXED)

    def frames(self, values: Mapping[str, Array]) -> dict[str, tuple[Array, Array]]:
        """Rotation (n, 3, 3) and position (n, 3) [m] of the links in the base.

        Args:
            values: values of joints, each (n,) [rad or m]; links behind other moving joints are
                omitted.
        """
        n = len(next(iter(values.values())))
        found = {BASE: (np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)))}
        for joint in self.joints:
            if joint.parent in found and (joint.kind == FIXED or joint.name in values):
                value = values[joint.name] if joint.kind != FIXED else np.zeros(n)
                found[joint.child] = _moved(joint, value, *found[joint.parent])
        return found


def frame_prefix(text: str) -> str:
    """Check the prefix of a robot's frame names; empty for a single robot.

    Raises:
        InputError: it is not allowed in frame names.
    """
    if not _PREFIX.fullmatch(text):
        raise InputError(
            f"frame_prefix {text!r}: letters, digits, '_', '-', '.' and single '/' are allowed, "
            "such as robot_1/, with no '/' in front"
        )
    return text


def _moved(joint: Joint, value: Array, rotation: Array, place: Array) -> tuple[Array, Array]:
    place = place + rotation @ joint.origin.translation
    rotation = rotation @ joint.origin.rotation
    motion = value[:, None] * joint.axis
    if joint.kind == PRISMATIC:
        return rotation, place + (rotation @ motion[..., None])[..., 0]
    return rotation @ rotations.exp(motion), place


def toward(direction: Array) -> Array:
    """Smallest rotation that turns z into a direction, (3,) -> (3, 3)."""
    axis = np.cross(Z, direction)
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, direction[2])
    return rotations.exp(angle * (axis / sine if sine > 0.0 else X))
