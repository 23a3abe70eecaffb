"""The drawing of a serial arm and the expected errors of its parts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.errors import ConfigError
from delta_calibration.geometry import rotations
from delta_calibration.sections import (
    angle,
    choice,
    flag,
    parts,
    place,
    quantity,
    refused,
    tolerance,
)

Array = NDArray[np.float64]

MODIFIED, STANDARD = "modified", "standard"
X = np.array([1.0, 0.0, 0.0])
_PLANE = 0.02  # [rad] tilt of axes up to which an arm moves in a plane, or a plane is upright


@dataclass(frozen=True)
class Link:
    """A joint and the transform to its axis (modified DH, Craig) or from it (standard DH).

        A_i = R_x(twist) T_x(length) R_z(q_i + zero) T_z(offset)      modified
        B_i = R_z(q_i + zero) T_z(offset) R_x(twist) T_x(length)      standard

    The modified row describes the transform from axis i - 1 (the base for the first) to axis i,
    the standard one that from axis i to axis i + 1 (the tool's frame for the last).

    `parallel` states that axes i - 1 and i are nearly parallel. Their common normal is then badly
    defined: an error of twist moves it far along the axes. Hayati's angle about y replaces the
    offset as a parameter, and the offset stays as drawn.
    """

    twist: float = angle(
        about="alpha: rotation about x, from the previous axis to this one (standard DH: from "
        "this one to the next)"
    )
    length: float = place(
        about="a: distance along x, from the previous axis to this one (standard DH: from this "
        "one to the next)"
    )
    offset: float = place(about="d: distance along the axis")
    zero: float = angle(
        default=0.0, about="theta: rotation about the axis, with the joint at its zero"
    )
    parallel: bool = flag(False, about="whether this axis is nearly parallel to the previous one")
    mass: float = quantity(
        "kg",
        least=0.0,
        default=0.0,
        about="mass of what turns with the joint, spread evenly towards the next joint; leave all "
        "out if centres of mass lie elsewhere: a diagnosis then fits the links' first moments",
    )


@dataclass(frozen=True)
class ArmDimensions:
    """The drawing of a serial arm.

    Raises:
        ConfigError: no link, a first axis marked parallel, home, tool or mount of wrong size, or
            motion in an upright plane, of which x and y determine no place.
    """

    links: tuple[Link, ...] = parts(
        Link, about="one link per joint, in the DH form of `convention`"
    )
    tool: Array = place(shape=(3,), about="tool centre point in the last link's frame")
    home: Array = angle(
        shape=(None,),
        about="joint readings in the middle of the workspace, in the preferred posture",
    )
    mount: Array = angle(shape=(3,), about="rotation of the tool about z, y, x")
    convention: str = choice(
        MODIFIED,
        STANDARD,
        default=MODIFIED,
        about="form of the links: modified DH (Craig, proximal) or standard DH (distal)",
    )

    def __post_init__(self) -> None:
        """Refuse dimensions that do not describe an arm."""
        if not self.links:
            raise ConfigError("links: none is not allowed; one or more")
        if self.links[0].parallel:
            raise ConfigError(
                "links[0].parallel: True is not allowed; the first axis has none before it to "
                "lie along"
            )
        for name, value, size in (
            ("home", self.home, len(self.links)),
            ("tool", self.tool, 3),
            ("mount", self.mount, 3),
        ):
            if value.shape != (size,) or not np.isfinite(value).all():
                raise refused(self, name, f"{size} finite numbers")
        if self.planar and abs(np.cos(self.modified.links[0].twist)) < _PLANE:
            raise ConfigError(
                f"links[0].twist_deg: {np.degrees(self.links[0].twist):g} is not allowed; all "
                "axes are parallel and level, and such an arm is commanded by x and y: turn the "
                "base frame, for example to 0 degrees, z along the axes"
            )

    @property
    def planar(self) -> bool:
        """Whether all axes are parallel, so that the tool moves in one plane only."""
        later = self.modified.links[1:]
        return bool(later) and all(abs(np.sin(link.twist)) < _PLANE for link in later)

    @property
    def modified(self) -> ArmDimensions:
        """The same arm in modified DH.

        Each alpha and a moves to the next link, because a modified row begins with them. Those
        of the last row become part of the tool:

            R_x(alpha) T_x(a) T(tool) R(mount) = T(a x + R_x(alpha) tool) R_x(alpha) R(mount)
        """
        if self.convention == MODIFIED:
            return self
        last = self.links[-1]
        before = ((0.0, 0.0), *((link.twist, link.length) for link in self.links[:-1]))
        links = (
            replace(link, twist=twist, length=length)
            for link, (twist, length) in zip(self.links, before, strict=True)
        )
        turn = rotations.exp(last.twist * X)
        mounted = turn @ Rotation.from_euler("ZYX", self.mount).as_matrix()
        return replace(
            self,
            links=tuple(links),
            tool=last.length * X + turn @ self.tool,
            mount=self.mount if last.twist == 0.0 else rotations.roll_pitch_yaw(mounted)[::-1],
            convention=MODIFIED,
        )

    @property
    def behind(self) -> tuple[float, float]:
        """alpha [rad] and a [m] after the last joint, from the last row of standard DH; else 0."""
        if self.convention == MODIFIED:
            return 0.0, 0.0
        return self.links[-1].twist, self.links[-1].length


@dataclass(frozen=True)
class ArmTolerances:
    """Standard deviations of an arm's parts about the drawing; `inf` where nothing is known."""

    length: float = tolerance(about="lengths and offsets of the links")
    twist: float = tolerance("mrad", about="directions of the axes")
    zero: float = tolerance("mrad", about="zero of an encoder")
    tool: float = tolerance(about="tool centre point, each coordinate")
    mount: float = tolerance("mrad", about="rotation of the tool about each axis")
