"""A camera over the plane that a machine works in: where the tool is in its picture.

    u = f (R (p - c))_xy / (R (p - c))_z      [px]

with c the camera's place and R its turn, straight down but for a tilt that nobody knows. What the
picture says of the plane follows from marks at known places by the homography between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.geometry import rotations

Array = NDArray[np.float64]

_DOWN = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; its lens draws straight lines straight."""

    place: Array  # (3,) [m] in the base
    rotation: Array  # (3, 3) from the base to the camera's axes
    focal: float  # [px]
    noise: float = 0.05  # [px] of a coordinate of a mark found in the picture

    @classmethod
    def over(
        cls, middle: Array, height: float, focal: float, rng: np.random.Generator
    ) -> Camera:
        """One over a place (3,) [m], tilted by about a degree."""
        tilt = rotations.exp(np.append(0.02 * rng.standard_normal(2), rng.uniform(-0.1, 0.1)))
        return cls(middle + np.array([0.0, 0.0, height]), tilt @ _DOWN, focal)

    def picture(self, points: Array) -> Array:
        """Where points (n, 3) [m] are in the picture, (n, 2) [px]."""
        seen = (points - self.place) @ self.rotation.T
        return np.asarray(self.focal * seen[:, :2] / seen[:, 2:])

    def find(self, points: Array, rng: np.random.Generator) -> Array:
        """The same as it is found in the picture, (n, 2) [px]."""
        return self.picture(points) + self.noise * rng.standard_normal((len(points), 2))


def homography(pixels: Array, plane: Array) -> Array:
    """H (3, 3) with H (u, v, 1) ~ (x, y, 1) of marks (n, 2) [px] at (n, 2) [m], n of 4 or more.

    By the smallest singular vector of the equations x (h_3 u) = h_1 u, y (h_3 u) = h_2 u.
    """
    u = np.column_stack([pixels, np.ones(len(pixels))])
    none = np.zeros_like(u)
    rows = [np.hstack([u, none, -plane[:, :1] * u]), np.hstack([none, u, -plane[:, 1:] * u])]
    return np.asarray(np.linalg.svd(np.concatenate(rows))[2][-1].reshape(3, 3))


def on_plane(h: Array, pixels: Array) -> Array:
    """Places (n, 2) [m] of pixels (n, 2) by the homography."""
    seen = np.column_stack([pixels, np.ones(len(pixels))]) @ h.T
    return np.asarray(seen[:, :2] / seen[:, 2:])
