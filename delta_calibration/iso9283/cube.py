"""The poses and paths of ISO 9283's test, in one diagonal plane of a cube.

From general knowledge of the standard, not from its text. The corners of each plane and the 10 and
80 % are those of the standard; the corner at which the numbering starts is our choice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError

Array = NDArray[np.float64]

PLANES = {
    "C1-C2-C7-C8": (0, 1, 6, 7),
    "C2-C3-C8-C5": (1, 2, 7, 4),
    "C3-C4-C5-C6": (2, 3, 4, 5),
    "C4-C1-C6-C7": (3, 0, 5, 6),
}
"""The four diagonal planes of the cube, by their corners in order round the rectangle."""


@dataclass(frozen=True)
class Cube:
    """The cube of the test, in the most used part of the workspace, its edges along the base axes.

    Corners C1..C4 go round the upper face from (+x, +y) through (-x, +y); C5..C8 lie below them.
    """

    centre: tuple[float, float, float]  # [m], base frame
    side: float  # [m]

    def __post_init__(self) -> None:
        """Refuse a centre that is not three finite lengths, or a side not above 0."""
        if np.shape(self.centre) != (3,) or not np.all(np.isfinite(self.centre)):
            raise InputError(f"centre is {self.centre}; it has to be three finite lengths")
        if not (np.isfinite(self.side) and self.side > 0.0):
            raise InputError(f"side is {self.side}; it has to be above 0 m")

    def corners(self) -> Array:
        """Return C1..C8 (8, 3) [m]."""
        round_ = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        upper, lower = np.insert(round_, 2, 1.0, axis=1), np.insert(round_, 2, -1.0, axis=1)
        return np.asarray(self.centre) + 0.5 * self.side * np.vstack([upper, lower])

    def plane_corners(self, plane: str = "C1-C2-C7-C8") -> Array:
        """Return the corners of a diagonal plane (4, 3) [m], in order round it.

        Raises:
            InputError: if the plane is not one of `PLANES`.
        """
        if plane not in PLANES:
            raise InputError(f"plane is {plane!r}; allowed: {', '.join(PLANES)}")
        return self.corners()[list(PLANES[plane]), :]

    def poses(self, plane: str = "C1-C2-C7-C8") -> Array:
        """Return P1..P5 (5, 3) [m]: the centre, then 10 % of a diagonal in from each corner."""
        middle, corners = np.asarray(self.centre), self.plane_corners(plane)
        return np.vstack([middle, corners + 0.2 * (middle - corners)])

    def line(self, plane: str = "C1-C2-C7-C8", stations: int = 101) -> Array:
        """Return the straight test path P2 to P4 (stations, 3) [m]: 80 % of the diagonal."""
        p = self.poses(plane)
        return np.asarray(np.linspace(p[1], p[3], stations))

    def circle(
        self, plane: str = "C1-C2-C7-C8", stations: int = 101, *, small: bool = False
    ) -> Array:
        """Return the circular test path about P1 (stations, 3) [m]; the last station is the first.

        The diameter is 80 % of the side, or a tenth of that if `small`.
        """
        a, b, _, d = self.plane_corners(plane)
        u, v = (b - a) / np.linalg.norm(b - a), (d - a) / np.linalg.norm(d - a)
        angle = np.linspace(0.0, 2.0 * np.pi, stations)[:, None]
        radius = 0.4 * self.side * (0.1 if small else 1.0)
        turned = radius * (np.cos(angle) * u + np.sin(angle) * v)
        return np.asarray(turned + self.centre)
