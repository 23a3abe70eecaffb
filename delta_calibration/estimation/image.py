"""Image points of a mark, from a camera that stands beside the machine (as in paper 003)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Predictor
from delta_calibration.estimation.measurements import (
    Linear,
    Observation,
    point_seen,
    require_shapes,
)
from delta_calibration.geometry import Camera, Frame

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PointInImage(Observation):
    """Image point of a mark on the platform, by a camera.

    The camera's pose is an unknown of the fit, or given as `place`, `T_camera_base`. An image has
    no scale: a machine twice as large, seen from twice as far, looks the same. If the camera's
    pose is unknown, the scale comes from the priors or from another observation.
    """

    kind: ClassVar[str] = "image"
    each: ClassVar[tuple[str, ...]] = ("joint", "pixel")

    joint: Array
    pixel: Array  # (n, 2) [px]
    offset: Array  # (3,) [m] of the mark in the platform
    camera: Camera
    noise: float  # [px] each coordinate
    place: Frame | None = None  # T_camera_base if it is known

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        require_shapes(self, pixel=(len(self.joint), 2), offset=(3,))

    @property
    def device(self) -> str:
        """The camera, unless its pose is given."""
        return "camera" if self.place is None else ""

    @property
    def sigma(self) -> Array:
        """Standard deviation of each image coordinate, (2,) [px]."""
        return np.full(2, self.noise)

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals (n, 2) [px] and their slopes; NaN rows out of reach or behind the camera."""
        seen = point_seen(at, theta, self.offset, self.place, guess)
        missed = np.asarray(self.pixel - self.camera.image(seen.reading))
        by_point = self.camera.image_by_point(seen.reading)
        return Linear(seen.x, missed, by_point @ seen.jacobian, by_point @ seen.by_joints, at.at)
