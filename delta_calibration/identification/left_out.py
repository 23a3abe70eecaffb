"""What every place is missed by when it is left out of a fit, to first order.

About a fit everything is linear in the unknowns z, r = S z + noise, with a prior of precision P.
Without a place p the data know I' = I - S_p^T S_p; then z' = A'^-1 (b - S_p^T r_p) with
A' = I' + P, the place is missed by r_p - S_p z', and the covariance of what was predicted of it is
S_p A'^-1 (s I' + P) A'^-1 S_p^T, with s by how much the noise is larger than was assumed.
(Allen 1974, Technometrics 16, 125-127: the residuals of PRESS, here of a place with all its
visits.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Known:
    """What data and priors know of the unknowns z, (P,)."""

    information: Array  # (P, P) I, of the data
    along: Array  # (P,) b, S^T r of the data
    prior: Array  # (P,) P, 0 where there is none

    @property
    def whole(self) -> Array:
        """A = I + P, (P, P)."""
        return self.information + np.diag(self.prior)

    def without(self, slope: Array, residual: Array) -> Known:
        """Without some of the data: slope (k, P) and residual (k,), whitened."""
        return Known(
            self.information - slope.T @ slope, self.along - slope.T @ residual, self.prior
        )

    def best(self) -> Array:
        """The most likely z, (P,)."""
        return np.asarray(np.linalg.solve(self.whole, self.along))

    def covariance(self, spread: float) -> Array:
        """Of z (P, P): A^-1 (s I + P) A^-1.

        Args:
            spread: s, at least 1. What only the priors know is as uncertain as before.
        """
        inverse = np.linalg.inv(self.whole)
        known = max(1.0, spread) * self.information + np.diag(self.prior)
        return np.asarray(inverse @ known @ inverse)


@dataclass(frozen=True)
class LeftOut:
    """Of n poses, each by the data without its place; whitened."""

    missed: Array  # (n, d)
    covariance: Array  # (n, d, d) of what was predicted


def left_out(known: Known, slope: Array, residual: Array, place: Index, spread: float) -> LeftOut:
    """What n poses are missed by without their own place.

    Args:
        known: by all data.
        slope: of these poses, as they are in `known`, (n, d, P), whitened.
        residual: at z = 0, (n, d), whitened.
        place: (n,) of each pose.
        spread: by how much the noise is larger than was assumed.
    """
    missed = np.empty_like(residual)
    covariance = np.empty((*residual.shape, residual.shape[1]))
    for number in np.unique(place):
        own = place == number
        flat = slope[own].reshape(-1, slope.shape[-1])
        others = known.without(flat, residual[own].reshape(-1))
        missed[own] = residual[own] - slope[own] @ others.best()
        carried = slope[own] @ others.covariance(spread)
        covariance[own] = carried @ np.swapaxes(slope[own], 1, 2)
    return LeftOut(missed, covariance)
