"""The part of space that a calibration covers: the convex hull of the poses it was made from."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from delta_calibration.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Region:
    """Convex hull of points in the base's frame, (v, 3) [m]."""

    vertices: Array
    _planes: Array = field(init=False, repr=False, compare=False)  # (f, 4): n . p + d <= 0 inside

    def __post_init__(self) -> None:
        """Compute the hull's planes.

        Raises:
            DataError: fewer than four points.
        """
        if len(self.vertices) < 4:
            raise DataError(f"a region needs 4 points or more, found {len(self.vertices)}")
        # Joggled, so that points of one plane (a disc) make a thin body instead of an error.
        hull = ConvexHull(self.vertices, qhull_options="QJ Pp")
        object.__setattr__(self, "_planes", hull.equations)

    @classmethod
    def of(cls, points: Array) -> Region:
        """The region of these points; only the corners are kept."""
        if len(points) < 4:
            return cls(points)
        hull = ConvexHull(points, qhull_options="QJ Pp")
        return cls(points[np.sort(hull.vertices)])

    def outside(self, points: Array) -> Array:
        """How far outside each point lies, (...,) [m]; negative inside.

        Beyond a face this is the distance; beyond an edge or a corner it is less, by at most the
        factor that the hull's faces meet at.
        """
        return np.asarray(np.max(points @ self._planes[:, :3].T + self._planes[:, 3], axis=-1))
