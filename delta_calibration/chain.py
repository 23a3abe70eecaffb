"""The chain of measurement: from joint angles to a reading of the tracker, and its derivatives.

    joint angle --closure of the mechanism--> pose --probe offset--> point in the base --frame-->
    reading

Simulator, fit and compensator all use this one chain. Its parameters are one vector theta: the
mechanism's geometry g, the reflector's offset o in the platform, the tracker's frame (where the
base stands in it):

    y = R(w_T) (p(q, g) + R(x) o) + t_T
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism
from delta_calibration.parameters import Parameter, ParameterSet

Array = NDArray[np.float64]

FRAME_NAMES = tuple(f"tracker_{kind}_{axis}" for kind in ("turn", "place") for axis in "xyz")
OFFSET_NAMES = tuple(f"reflector_{axis}" for axis in "xyz")


@dataclass(frozen=True)
class Chain:
    """A mechanism, a reflector on its platform, a tracker that looks at it.

    `offset` (3,) [m] is the reflector's nominal place in the platform's frame, `offset_prior` [m]
    what it is expected to deviate by.
    """

    mechanism: Mechanism
    offset: Array
    offset_prior: float

    @property
    def parameters(self) -> ParameterSet:
        """Geometry, reflector offset, tracker frame, in the order of theta."""
        offset = tuple(
            Parameter(name, "m", float(value), self.offset_prior, "smr_offset")
            for name, value in zip(OFFSET_NAMES, self.offset, strict=True)
        )
        frame = tuple(
            Parameter(name, "rad" if "turn" in name else "m", 0.0, float("inf"), "tracker_frame")
            for name in FRAME_NAMES
        )
        return self.mechanism.parameters + ParameterSet(offset) + ParameterSet(frame)

    @property
    def geometry_size(self) -> int:
        """How many of theta's first entries are the mechanism's geometry."""
        return len(self.mechanism.parameters)

    def split(self, theta: Array) -> tuple[Array, Array, Frame]:
        """Geometry (p,), reflector offset (3,) [m], frame `T_tracker_base`."""
        p = self.geometry_size
        return theta[:p], theta[p : p + 3], Frame.from_vector(theta[p + 3 : p + 9])

    def join(self, geometry: Array, offset: Array, frame: Frame) -> Array:
        """The vector theta of the three parts."""
        return np.concatenate([geometry, offset, frame.vector()])

    def pose(self, q: Array, theta: Array, guess: Array | None = None) -> Array:
        """Platform's pose in the base, (n, k); NaN rows out of reach."""
        return self.mechanism.forward(q, theta[: self.geometry_size], guess)

    def reading(self, x: Array, theta: Array) -> Array:
        """What the tracker sees of a platform at x, (n, 3) [m] in the tracker's frame."""
        _, offset, frame = self.split(theta)
        return frame.apply(self.point(x, offset))

    def point(self, x: Array, offset: Array) -> Array:
        """A point fixed to the platform, in the base, (n, 3) [m]."""
        return self.mechanism.position(x) + self.mechanism.rotation(x) @ offset

    def point_by_pose(self, x: Array, offset: Array) -> Array:
        """d(point)/dx, (n, 3, k)."""
        slope = np.zeros((len(x), 3, self.mechanism.pose_size))
        slope[:, :, :3] = np.eye(3)
        if self.mechanism.pose_size == 6:
            each = np.broadcast_to(offset, (len(x), 3))
            slope[:, :, 3:] = rotations.exp_times_derivative(x[:, 3:], each)
        return slope

    def point_by_joints(self, q: Array, x: Array, theta: Array) -> Array:
        """d(reflector in the base)/dq, (n, 3, m) [m/rad]."""
        geometry, offset, _ = self.split(theta)
        return self.point_by_pose(x, offset) @ self.mechanism.velocity_jacobian(q, x, geometry)

    def jacobian(self, q: Array, x: Array, theta: Array) -> Array:
        """d(reading)/d(theta), (n, 3, P), at constant joints."""
        geometry, offset, frame = self.split(theta)
        by_geometry = self.mechanism.identification_jacobian(q, x, geometry)
        by_geometry = self.point_by_pose(x, offset) @ by_geometry
        by_offset = self.mechanism.rotation(x)
        point = self.point(x, offset)
        turn = np.broadcast_to(theta[self.geometry_size + 3 : self.geometry_size + 6], point.shape)
        return np.concatenate(
            [
                frame.rotation @ by_geometry,
                frame.rotation @ by_offset,
                rotations.exp_times_derivative(turn, point),
                np.broadcast_to(np.eye(3), (len(q), 3, 3)),
            ],
            axis=-1,
        )
