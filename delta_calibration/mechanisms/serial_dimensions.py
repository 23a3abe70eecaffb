"""The drawing of a serial arm and the expected errors of its parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ConfigError
from delta_calibration.sections import angle, flag, parts, place, quantity, refused, tolerance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Link:
    """From joint axis i - 1 (the base for the first) to axis i, modified DH (Craig).

        A_i = R_x(twist) T_x(length) R_z(q_i + zero) T_z(offset)

    `parallel` says that the two axes are nearly so. Their common normal is then badly defined: an
    error of twist moves it far along the axes. Hayati's angle about y takes the offset's place
    among what can be wrong, and the offset stays as drawn.
    """

    twist: float = angle(about="alpha: from the axis before to this one, about x")
    length: float = place(about="a: from the axis before to this one, along x")
    offset: float = place(about="d: along the axis")
    zero: float = angle(default=0.0, about="theta: about the axis, with the joint at its zero")
    parallel: bool = flag(False, about="whether this axis lies nearly along the one before")
    mass: float = quantity(
        "kg",
        least=0.0,
        default=0.0,
        about="of what turns with the joint, spread along the way to the next",
    )


@dataclass(frozen=True)
class ArmDimensions:
    """The drawing of a serial arm.

    Raises:
        ConfigError: no link, a first axis said to be parallel, or a home of another size.
    """

    links: tuple[Link, ...] = parts(Link, about="one a joint, modified DH (Craig)")
    tool: Array = place(shape=(3,), about="tool centre point in the last link")
    home: Array = angle(
        shape=(None,),
        about="what the joints read in the middle of the workspace, in the posture wanted",
    )
    mount: Array = angle(shape=(3,), about="how the tool is turned, about z, y, x")

    def __post_init__(self) -> None:
        """Refuse what no arm can be made of."""
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


@dataclass(frozen=True)
class ArmTolerances:
    """Standard deviations of an arm's parts about the drawing; `inf` where nothing is known."""

    length: float = tolerance(about="lengths and offsets of the links")
    twist: float = tolerance("mrad", about="directions of the axes")
    zero: float = tolerance("mrad", about="zero of an encoder")
    tool: float = tolerance(about="tool centre point, each coordinate")
    mount: float = tolerance("mrad", about="how the tool is turned, each axis")
