"""Pinhole camera: projection of points to pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """Pinhole camera without skew; lens distortion is absent or already corrected.

        u = f_u X / Z + c_u        v = f_v Y / Z + c_v

    (X, Y, Z) [m] in the camera's frame: x to the right and y down in the image, z ahead. Pixels
    count from the corner of the image.
    """

    focal: Array  # f, (2,) [px]
    centre: Array  # c, (2,) [px] where the optical axis meets the image

    def __post_init__(self) -> None:
        """Refuse a focal length or centre that defines no image."""
        for name in ("focal", "centre"):
            value = getattr(self, name)
            if value.shape != (2,) or not np.isfinite(value).all():
                raise InputError(f"camera: {name} {value} is not allowed; 2 finite numbers [px]")
        if not (self.focal > 0).all():
            raise InputError(f"camera: focal {self.focal} is not allowed; above 0 px")

    def image(self, points: NDArray[Any]) -> NDArray[Any]:
        """Pixels of points in the camera's frame, (n, 3) [m] -> (n, 2) [px]; NaN behind it."""
        ahead = points[:, 2:].real > 0
        depth = np.where(ahead, points[:, 2:], np.nan)
        return np.asarray(self.focal * points[:, :2] / depth + self.centre)

    def image_by_point(self, points: Array) -> Array:
        """Derivative of the pixels by the points, (n, 3) [m] -> (n, 2, 3) [px/m]."""
        slope = np.zeros((len(points), 2, 3))
        slope[:, 0, 0], slope[:, 1, 1] = self.focal
        slope[:, :, 2] = -self.focal * points[:, :2] / points[:, 2:]
        return slope / points[:, 2:, None]

    def rays(self, pixels: Array) -> Array:
        """Directions of the pixels in the camera's frame, (n, 2) [px] -> (n, 3), z = 1."""
        return np.column_stack([(pixels - self.centre) / self.focal, np.ones(len(pixels))])
