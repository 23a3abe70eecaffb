"""Rigid frames and the best rigid motion between two sets of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.geometry import rotations

Array = NDArray[np.float64]

_THIN = 1e-6  # ratio of second to largest spread under which points count as lying on one line
_SMALL = 1e-9  # of the normal equations' diagonal, for what the points do not tell


@dataclass(frozen=True)
class Frame:
    """A rigid motion `T_a_b`: takes coordinates in b to coordinates in a, p_a = R p_b + t."""

    rotation: Array  # (3, 3)
    translation: Array  # (3,) [m]

    @classmethod
    def identity(cls) -> Frame:
        """The motion that does nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_vector(cls, vector: Array) -> Frame:
        """From (6,): rotation vector [rad], translation [m]."""
        return cls(rotations.exp(vector[:3]), np.array(vector[3:6], dtype=float))

    def vector(self) -> Array:
        """As (6,): rotation vector [rad], translation [m]."""
        return np.concatenate([rotations.log(self.rotation), self.translation])

    def apply(self, points: Array) -> Array:
        """Points of frame b, (..., 3), in frame a."""
        return points @ self.rotation.T + self.translation

    def inverse(self) -> Frame:
        """`T_b_a`."""
        return Frame(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Frame) -> Frame:
        """`T_a_b @ T_b_c = T_a_c`."""
        return Frame(self.rotation @ other.rotation, self.apply(other.translation))


def align(source: Array, target: Array, weights: Array | None = None) -> Frame:
    """Rigid motion that takes `source` to `target` with least weighted squared distance.

    Singular value decomposition of the cross covariance with the reflection excluded (Arun 1987,
    Umeyama 1991).

    Args:
        source: points, (n, 3) [m].
        target: the same points in the other frame, (n, 3) [m].
        weights: (n,), equal where not given.

    Raises:
        DataError: fewer than three points, or all on one line, in either frame: the turn about it
            is free.
    """
    if len(source) < 3:
        raise DataError(f"a frame needs 3 points or more, found {len(source)}")
    w = np.ones(len(source)) if weights is None else weights
    w = w[:, None] / w.sum()
    centre_s, centre_t = (w * source).sum(axis=0), (w * target).sum(axis=0)
    s, t = source - centre_s, target - centre_t
    spreads = [np.linalg.svd(np.sqrt(w) * points, compute_uv=False) for points in (s, t)]
    if any(spread[1] <= _THIN * spread[0] for spread in spreads):
        raise DataError("a frame needs points off one line: the turn about that line is free")
    u, _, vt = np.linalg.svd((w * t).T @ s)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ flip @ vt
    return Frame(rotation, centre_t - rotation @ centre_s)


def carried_step(
    turned: Array, about: Array, left: Array, weights: Array, pull: float, toward: Array
) -> Array:
    """How far to move a point that turning bodies carry, while the frame they are seen in follows.

    Place, turn and point are one step of least squares: each alone would creep along the valley
    that the others leave.

    Args:
        turned: (n, 3, 3) from the bodies to the frame in which the point is seen.
        about: (n, 3) [m] predicted points about their middle.
        left: (n, 3) [m] seen less predicted.
        weights: (n,).
        pull: weight of `toward`.
        toward: (3,) [m] step to where the point is expected, which decides if the bodies do not
            turn.

    Returns:
        (3,) [m], in the bodies.
    """
    columns = np.concatenate(
        [-rotations.skew(about), np.broadcast_to(np.eye(3), turned.shape), turned], axis=2
    )
    normal = np.einsum("n,nij,nik->jk", weights, columns, columns)
    normal[6:, 6:] += pull * np.eye(3)
    normal += _SMALL * np.diag(np.diag(normal))
    right = np.einsum("n,nij,ni->j", weights, columns, left)
    right[6:] += pull * toward
    return np.asarray(np.linalg.solve(normal, right)[6:])
