"""Pose of a camera relative to a robot's base, and positions in a plane from its image.

A single image has no depth: a mark is assumed to lie in the plane of the target, z constant in the
base (paper 003: a SCARA's plane). If the mark lies off this plane, the position error is that
distance times the tangent of the viewing angle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.estimation import PointInImage, fit_observations
from delta_calibration.geometry import Frame, rotations
from delta_calibration.plans import tool_points
from delta_calibration.robot import Robot, Sight

Array = NDArray[np.float64]

_THIN = 1e-6  # singular values below this fraction of the largest count as zero
FEWEST_CAMERA_STOPS = 4  # eight pixel coordinates for six unknowns


@dataclass(frozen=True)
class CameraFrame:
    """Pose of a camera, fitted to stops of the robot itself, or known.

    As with a tracker, the rigid-body part of the robot's error is absorbed by the fitted frame.
    """

    sight: Sight
    frame: Frame  # T_camera_base
    stops: int = 0
    rest: float = 0.0  # [m] RMS distance of the stops from their commands, in their plane

    @classmethod
    def on(cls, robot: Robot, sight: Sight, joint: Array, pixel: Array) -> CameraFrame:
        """Fit the pose to stops at nominal joints (n, m) with the mark seen at pixels (n, 2).

        Raises:
            DataError: too few stops, or on one line, or no pose explains the pixels.
        """
        if len(joint) < FEWEST_CAMERA_STOPS:
            raise DataError(
                f"{len(joint)} stops; the frame of a camera needs {FEWEST_CAMERA_STOPS}"
            )
        model, points = robot.commanded, tool_points(robot, joint)
        seen = PointInImage(joint, pixel, robot.tool_offset, sight.camera, sight.noise)
        drawn = np.zeros(len(model.parameters), dtype=bool)
        start = _over_plane(points, sight.camera.rays(pixel))
        frame = fit_observations(model, [seen], start, drawn, priors=False).machine.frame
        laid = cls(sight, frame, len(joint))
        off = [
            laid.in_plane(at, float(point[2])) - point
            for at, point in zip(pixel, points, strict=True)
        ]
        return replace(laid, rest=float(np.sqrt(np.mean(np.sum(np.square(off), axis=1)))))

    @property
    def std(self) -> float:
        """Standard deviation of a point due to the choice of stops [m]: six unknowns, 2 n data."""
        return self.rest * float(np.sqrt(6.0 / max(2.0 * self.stops - 6.0, 1.0)))

    def in_plane(self, pixel: Array, height: float) -> Array:
        """Position in the base of a mark at z = height [m], by its pixel (2,) [px] -> (3,) [m]."""
        back = self.frame.inverse()
        ray = back.rotation @ self.sight.camera.rays(pixel[None])[0]
        return np.asarray(
            back.translation + ray * (height - back.translation[2]) / ray[2], dtype=float
        )

    def noise(self, point: Array) -> float:
        """Standard deviation of an in-plane coordinate from one image [m], at a point (3,) [m]."""
        depth = float(self.frame.apply(point)[2])
        return self.sight.noise * depth / float(self.sight.focal.min())

    def __str__(self) -> str:
        """Sentence on the uncertainty due to the fitted frame."""
        return (
            f"position of the camera from {self.stops} stops of the robot itself, which deviate "
            f"from it by {self.rest * 1e3:.3f} mm (RMS); other stops would shift it by about "
            f"{self.std * 1e3:.3f} mm. Points are corrected in this frame; an error that moves "
            "the whole robot relative to its base is not visible in it"
        )


def _over_plane(points: Array, rays: Array) -> Frame:
    """`T_camera_base` from points (n, 3) [m] at about one height and the rays (n, 3) to them.

    The homography of the plane is H = s [r_x, r_y, t + h r_z]; it is the right singular vector of
    the smallest singular value of ray x (H (x, y, 1)) = 0 (Zhang 2000).

    Raises:
        DataError: points on one line.
    """
    height = float(points[:, 2].mean())
    plane = np.column_stack([points[:, :2], np.ones(len(points))])
    rows = rotations.skew(rays)[..., None] * plane[:, None, None, :]
    values, across = np.linalg.svd(rows.reshape(-1, 9))[1:]
    if values[-2] <= _THIN * values[0]:
        raise DataError("the position of a camera needs stops that do not lie on one line")
    columns = across[-1].reshape(3, 3)
    columns *= np.sign(np.sum(plane @ columns.T * rays)) / np.linalg.norm(columns[:, :2]) * 2**0.5
    along, across_it, place = columns.T
    u, _, vt = np.linalg.svd(np.column_stack([along, across_it, np.cross(along, across_it)]))
    rotation = u @ vt
    return Frame(rotation, place - height * rotation[:, 2])
