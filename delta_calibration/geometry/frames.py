"""Rigid frames and the best rigid motion between two sets of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.geometry import rotations

Array = NDArray[np.float64]

_THIN = 1e-6  # ratio of second to largest spread under which points count as lying on one line
_SMALL = 1e-9  # of the normal equations' diagonal, added for what the points do not determine


@dataclass(frozen=True)
class Frame:
    """A rigid motion `T_a_b`: takes coordinates in b to coordinates in a, p_a = R p_b + t."""

    rotation: Array  # (3, 3)
    translation: Array  # (3,) [m]

    @classmethod
    def identity(cls) -> Frame:
        """Return the identity, which moves nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_vector(cls, vector: Array) -> Frame:
        """Build it from (6,): rotation vector [rad], translation [m]."""
        return cls(rotations.exp(vector[:3]), np.array(vector[3:6], dtype=float))

    def vector(self) -> Array:
        """Return it as (6,): rotation vector [rad], translation [m]."""
        return np.concatenate([rotations.log(self.rotation), self.translation])

    def apply(self, points: Array) -> Array:
        """Transform points (..., 3) from frame b to frame a."""
        return points @ self.rotation.T + self.translation

    def inverse(self) -> Frame:
        """Return the inverse motion, `T_b_a`."""
        return Frame(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Frame) -> Frame:
        """Compose two motions: `T_a_b @ T_b_c = T_a_c`."""
        return Frame(self.rotation @ other.rotation, self.apply(other.translation))


def align(source: Array, target: Array, weights: Array | None = None) -> Frame:
    """Rigid motion that takes `source` to `target` with least weighted squared distance.

    Singular value decomposition of the cross covariance with the reflection excluded (Arun 1987,
    Umeyama 1991).

    Args:
        source: points, (n, 3) [m].
        target: the same points in the other frame, (n, 3) [m].
        weights: (n,), equal if not given.

    Raises:
        DataError: fewer than three points, or all on one line in either frame, about which the
            rotation is undetermined.
    """
    if len(source) < 3:
        raise DataError(f"a frame needs 3 points or more, found {len(source)}")
    w = np.ones(len(source)) if weights is None else weights
    w = w[:, None] / w.sum()
    centre_s, centre_t = (w * source).sum(axis=0), (w * target).sum(axis=0)
    s, t = source - centre_s, target - centre_t
    spreads = [np.linalg.svd(np.sqrt(w) * points, compute_uv=False) for points in (s, t)]
    if any(spread[1] <= _THIN * spread[0] for spread in spreads):
        raise DataError("a frame needs points that do not lie on one line")
    u, _, vt = np.linalg.svd((w * t).T @ s)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ flip @ vt
    return Frame(rotation, centre_t - rotation @ centre_s)


def carried_step(
    turned: Array, about: Array, left: Array, weights: Array, pull: float, toward: Array
) -> Array:
    """Least-squares step of a point on a rotating body, with the measuring frame free to follow.

    Translation and rotation of the frame and the point are solved together: one at a time, they
    would converge slowly along the valley that the others leave.

    Args:
        turned: (n, 3, 3) rotations from the body to the measuring frame.
        about: (n, 3) [m] predicted points relative to their mean.
        left: (n, 3) [m] measured less predicted.
        weights: (n,).
        pull: weight of `toward`.
        toward: (3,) [m] step to the expected point, which determines the result if the body does
            not rotate.

    Returns:
        Step of the point, (3,) [m], in the body's frame.
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
