"""The part of space that a calibration covers: the convex hull of the poses it was made from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from delta_calibration.errors import DataError

Array = NDArray[np.float64]

_FLAT = 0.05  # of the largest extent; a body thinner than this is flat
_SKIN = 0.5e-3  # [m] either side of a flat body


@dataclass(frozen=True)
class Region:
    """Convex hull of points in the base's frame, (v, 3) [m]."""

    vertices: Array

    def __post_init__(self) -> None:
        """Refuse what has no inside.

        Raises:
            DataError: fewer than four points.
        """
        if len(self.vertices) < 4:
            raise DataError(f"a region needs 4 points or more, found {len(self.vertices)}")

    @cached_property
    def _planes(self) -> Array:
        """Of the hull's faces, (f, 4): n . p + d <= 0 inside."""
        # Joggled, so that many points of one plane are no error.
        return np.asarray(ConvexHull(self.vertices, qhull_options="QJ Pp").equations)

    @classmethod
    def of(cls, points: Array) -> Region:
        """The region of these points, half a millimetre thicker where they are flat.

        Only the corners are kept.
        """
        if len(points) < 4:
            return cls(points)
        solid = _thickened(points)
        hull = ConvexHull(solid, qhull_options="QJ Pp")
        return cls(solid[np.sort(hull.vertices)])

    @property
    def planes(self) -> Array:
        """The hull's faces, (f, 4): n . p + d is negative inside [m]."""
        return self._planes

    @property
    def faces(self) -> Array:
        """Triangles of the hull, (f, 3 corners, 3) [m]."""
        hull = ConvexHull(self.vertices, qhull_options="QJ Pp")
        return np.asarray(self.vertices[hull.simplices])

    def outside(self, points: Array) -> Array:
        """How far outside each point lies, (...,) [m]; negative inside.

        Beyond a face this is the distance; beyond an edge or a corner it is less, by at most the
        factor that the hull's faces meet at.
        """
        return np.asarray(np.max(points @ self._planes[:, :3].T + self._planes[:, 3], axis=-1))

    def sample(self, n: int, margin: float, rng: np.random.Generator) -> Array:
        """Points less than `margin` [m] outside: beyond each corner, and n others.

        A third of the others lie on the boundary, the rest are spread inside. All are found along
        rays from the middle, drawn as the corners lie, so that a thin body is met as well.
        """
        middle = self.vertices.mean(axis=0)
        corners = self.vertices - middle
        rays = np.concatenate([corners, rng.standard_normal((n, 3)) @ np.linalg.qr(corners)[1]])
        slope = rays @ self._planes[:, :3].T
        room = margin - (self._planes[:, :3] @ middle + self._planes[:, 3])
        with np.errstate(divide="ignore"):
            reach = np.where(slope > 0, room / slope, np.inf).min(axis=1)
        share = np.full(len(rays), 1 - 1e-9)  # of the way: none is outside by rounding
        share[len(corners) + n // 3 :] = np.cbrt(rng.random(n - n // 3))
        return np.asarray(middle + (share * reach)[:, None] * rays)


def _thickened(points: Array) -> Array:
    """Points of a disc or a line drawn out either way along the directions they are thin in.

    A disc's hull would else have no faces round its rim but two that meet there at a sharp edge,
    and a point in its plane, however far outside, would lie on both.
    """
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    extent = np.ptp(points @ axes.T, axis=0)
    for axis in axes[extent < _FLAT * extent.max()]:
        points = np.concatenate([points - _SKIN * axis, points + _SKIN * axis])
    return points
