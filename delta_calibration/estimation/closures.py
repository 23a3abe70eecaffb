"""Closure equations of a redundant mechanism as observations: joints must be consistent.

With more closures r than coordinates k of the pose there is a misfit with and without a measured
pose:

    pose known      f(q, x, g)                        r numbers
    pose unknown    N^T f(q, x*, g), N^T f_x = 0      r - k, at the pose x* of least misfit

N is an orthonormal basis of the left null space of f_x, so no misfit is lost: |N^T f| = |f| at x*.
Of all such bases it is the nearest to a fixed one, cosines over the closures, so that it changes
smoothly with the pose and neighbours can be compared. The noise is that of the closures, equal in
each and in their own unit; for encoder noise see `EncoderClosure` (`encoder_closures.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Predictor
from delta_calibration.errors import InputError
from delta_calibration.estimation.measurements import (
    Linear,
    Observation,
    require_shapes,
    standing,
    through_closures,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClosureAtPose(Observation):
    """Joints at poses that were measured independently in the robot's frame, more accurately.

    The noise of the measured poses is neglected.
    """

    kind: ClassVar[str] = "closure"
    each: ClassVar[tuple[str, ...]] = ("joint", "pose")

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
        """Standard deviation of each closure, (r,)."""
        return np.full(self.size, self.noise)

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals 0 - f, (n, r), and their slopes."""
        seen, g = standing(at, theta, guess)
        mechanism, q, x = at.chain.mechanism, seen.joint, self.pose
        by_joints = mechanism.closure_by_joints(q, x, g)
        slope = through_closures(at, theta, by_joints, mechanism.closure_by_geometry(q, x, g))
        return Linear(x, -mechanism.closure(q, x, g), slope, by_joints, at.at)


@dataclass(frozen=True)
class ClosureWithoutPose(Observation):
    """Joints at poses that were not measured; the noise is that of the closures."""

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
        """Standard deviation of each number, (r - k,)."""
        return np.full(self.redundancy, self.noise)

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals 0 - N^T f, (n, r - k); derivatives at zero misfit, without that of N."""
        seen, g = standing(at, theta, guess)
        mechanism, q, x = at.chain.mechanism, seen.joint, seen.x
        kept = self._kept(mechanism.closure_by_pose(q, x, g), x)
        by_joints = kept @ mechanism.closure_by_joints(q, x, g)
        by_geometry = kept @ mechanism.closure_by_geometry(q, x, g)
        missed = -(kept @ mechanism.closure(q, x, g)[..., None])[..., 0]
        slope = through_closures(at, theta, by_joints, by_geometry)
        return Linear(x, missed, slope, by_joints, at.at)

    def _kept(self, by_pose: Array, x: Array) -> Array:
        """N^T, (n, r - k, r); NaN rows out of reach."""
        kept = np.full((len(x), self.redundancy, by_pose.shape[1]), np.nan)
        known = np.isfinite(x).all(axis=1)
        kept[known] = spared(by_pose[known])
        return kept


def spared(by_pose: Array) -> Array:
    """N^T of the left null space of f_x, in the basis nearest to cosines.  -> (n, r - k, r).

    f_x is (n, r, k). Of all orthonormal bases N A, the one with A = V U^T is the nearest to the
    cosines E, where E^T N = U S V^T (orthogonal Procrustes problem).
    """
    rows, size = by_pose.shape[1:]
    free = unmoved(by_pose)
    at = (np.arange(rows) + 0.5) * np.pi / rows
    fixed = np.cos(at[:, None] * np.arange(rows - size))
    u, _, vh = np.linalg.svd(fixed.T @ free)
    return np.asarray(u @ vh @ np.swapaxes(free, 1, 2))


def unmoved(by_pose: Array) -> Array:
    """N: some basis of the left null space of f_x.  (n, r, k) -> (n, r, r - k)."""
    return np.linalg.qr(by_pose, mode="complete").Q[..., by_pose.shape[-1] :]
