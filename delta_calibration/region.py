"""The region where a calibration is valid: the convex hull of the measured positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from delta_calibration.errors import DataError
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]

_FLAT = 0.05  # a body thinner than this share of its largest extent is flat
_SKIN = 0.5e-3  # [m] thickness added on either side of a flat body


@dataclass(frozen=True)
class Region:
    """Convex hull of points in the base's frame, (v, 3) [m]."""

    vertices: Array

    def __post_init__(self) -> None:
        """Refuse points that span no volume.

        Raises:
            DataError: fewer than four points.
        """
        if len(self.vertices) < 4:
            raise DataError(f"a region needs 4 points or more, found {len(self.vertices)}")

    @cached_property
    def _planes(self) -> Array:
        """Planes of the hull's faces, (f, 4): n . p + d <= 0 inside [m]."""
        # Joggled, so that many points in one plane cause no error.
        return np.asarray(ConvexHull(self.vertices, qhull_options="QJ Pp").equations)

    @classmethod
    def of(cls, points: Array) -> Region:
        """Build the region of these points; flat ones get half a millimetre on either side.

        Only the vertices of the hull are kept.
        """
        if len(points) < 4:
            return cls(points)
        solid = _thickened(points)
        hull = ConvexHull(solid, qhull_options="QJ Pp")
        return cls(solid[np.sort(hull.vertices)])

    @property
    def planes(self) -> Array:
        """Planes of the hull's faces, (f, 4): n . p + d is negative inside [m]."""
        return self._planes

    @property
    def faces(self) -> Array:
        """Triangles of the hull, (f, 3 corners, 3) [m]."""
        hull = ConvexHull(self.vertices, qhull_options="QJ Pp")
        return np.asarray(self.vertices[hull.simplices])

    def outside(self, points: Array) -> Array:
        """Largest signed distance of each point from the planes of the faces, (...,) [m].

        It is negative inside. Beyond a face it is the distance from the region; beyond an edge or
        a corner it is smaller, by a factor that depends on the angle between the faces.
        """
        return np.asarray(np.max(points @ self._planes[:, :3].T + self._planes[:, 3], axis=-1))

    def sample(self, n: int, margin: float, rng: np.random.Generator) -> Array:
        """Draw points up to `margin` [m] outside: one beyond each vertex, and n others.

        A third of the others lie on the boundary, the rest are spread inside. All lie on rays from
        the middle, drawn with the covariance of the vertices, so that a thin body is covered too.
        """
        middle = self.vertices.mean(axis=0)
        corners = self.vertices - middle
        rays = np.concatenate([corners, rng.standard_normal((n, 3)) @ np.linalg.qr(corners)[1]])
        slope = rays @ self._planes[:, :3].T
        room = margin - (self._planes[:, :3] @ middle + self._planes[:, 3])
        with np.errstate(divide="ignore"):
            reach = np.where(slope > 0, room / slope, np.inf).min(axis=1)
        share = np.full(len(rays), 1 - 1e-9)  # of the reach: rounding puts no point outside
        share[len(corners) + n // 3 :] = np.cbrt(rng.random(n - n // 3))
        return np.asarray(middle + (share * reach)[:, None] * rays)


def _thickened(points: Array) -> Array:
    """Thicken the points of a disc or a line along the directions in which they are thin.

    Otherwise the hull of a disc would have only two faces, which meet at the rim in a sharp edge,
    and a point in its plane, however far outside, would lie on both.
    """
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    extent = np.ptp(points @ axes.T, axis=0)
    for axis in axes[extent < _FLAT * extent.max()]:
        points = np.concatenate([points - _SKIN * axis, points + _SKIN * axis])
    return points
