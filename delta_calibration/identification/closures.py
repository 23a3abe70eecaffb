"""A redundant mechanism's closures as what is measured: joints that have to fit some pose.

With more closures r than coordinates k of the pose there is something to be missed whether
anybody looked or not:

    pose known      f(q, x, g)                        r numbers
    nobody looked   N^T f(q, x*, g), N^T f_x = 0      r - k, at the pose x* of least misfit

N is an orthonormal basis of what no pose changes, so that no misfit is lost: |N^T f| = |f| at x*.
It is the one nearest to a fixed basis, cosines over the closures, so that it turns smoothly with
the pose and neighbours can be compared. The noise is one of the closures, alike in each and in
their own unit; where it is one of encoders see `EncoderClosure` (`encoder_closures.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.identification.observations import (
    Machine,
    Observation,
    require_shapes,
    without_frame,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClosureAtPose(Observation):
    """Joints at a pose that somebody else measured in the robot's frame, and better than them.

    Leaves out the pose's own noise.
    """

    kind: ClassVar[str] = "closure"

    joint: Array  # (n, m) [rad, m]
    pose: Array  # (n, k) [m, rad]
    size: int  # r
    noise: float  # of each closure, in its unit

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together.

        Raises:
            InputError: names what does not.
        """
        require_shapes(self, pose=(len(self.joint), self.pose.shape[-1]))

    @property
    def sigma(self) -> Array:
        """(r,)."""
        return np.full(self.size, self.noise)

    def missed(self, machine: Machine) -> Array:
        """Nothing less the misfit, (n, r)."""
        return -machine.mechanism.closure(self.joint, self.pose, machine.geometry)

    def slopes(self, machine: Machine) -> Array:
        """(n, r, p + 6)."""
        geometry = machine.geometry
        return without_frame(
            machine.mechanism.closure_by_geometry(self.joint, self.pose, geometry)
        )


@dataclass(frozen=True)
class ClosureWithoutPose(Observation):
    """Joints at poses that nobody measured; the noise is one of what the closures say."""

    kind: ClassVar[str] = "closure alone"

    joint: Array  # (n, m) [rad, m]
    redundancy: int  # r - k
    noise: float  # of each closure, in its unit

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together.

        Raises:
            InputError: names what does not.
        """
        require_shapes(self)
        if self.redundancy < 1:
            raise InputError(
                f"closure alone: redundancy {self.redundancy} is not allowed; 1 or more"
            )

    @property
    def sigma(self) -> Array:
        """(r - k,)."""
        return np.full(self.redundancy, self.noise)

    def missed(self, machine: Machine) -> Array:
        """Nothing less the misfit, (n, r - k); NaN rows out of reach."""
        x = machine.poses(self.joint)
        f = machine.mechanism.closure(self.joint, x, machine.geometry)
        return np.asarray(-(self._kept(machine, x) @ f[..., None])[..., 0])

    def slopes(self, machine: Machine) -> Array:
        """(n, r - k, p + 6); to first order in what is missed."""
        x = machine.poses(self.joint)
        slope = machine.mechanism.closure_by_geometry(self.joint, x, machine.geometry)
        return without_frame(self._kept(machine, x) @ slope)

    def _kept(self, machine: Machine, x: Array) -> Array:
        """N^T, (n, r - k, r)."""
        by_pose = machine.mechanism.closure_by_pose(self.joint, x, machine.geometry)
        kept = np.full((len(x), self.redundancy, by_pose.shape[1]), np.nan)
        known = np.isfinite(x).all(axis=1)
        kept[known] = spared(by_pose[known])
        return kept


def spared(by_pose: Array) -> Array:
    """N^T: what no pose changes of the closures, nearest to cosines.  (n, r, k) -> (n, r - k, r).

    Of all orthonormal bases N A the nearest to E is that with A the rotation in E^T N = U S V^T.
    """
    rows, size = by_pose.shape[1:]
    free = unmoved(by_pose)
    at = (np.arange(rows) + 0.5) * np.pi / rows
    fixed = np.cos(at[:, None] * np.arange(rows - size))
    u, _, vh = np.linalg.svd(fixed.T @ free)
    return np.asarray(u @ vh @ np.swapaxes(free, 1, 2))


def unmoved(by_pose: Array) -> Array:
    """N: what no pose changes of the closures, in any basis.  (n, r, k) -> (n, r, r - k)."""
    return np.linalg.qr(by_pose, mode="complete").Q[..., by_pose.shape[-1] :]
