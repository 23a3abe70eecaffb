"""Studentized residuals of a fit: corrected, to first order, for the part that it absorbed.

About a fit everything is linear in the unknowns z, r = S z + noise, with a prior of precision P.
A fit absorbs a part of the errors that its model does not describe: with A = S^T S + P and the
leverage H = S_p A^-1 S_p^T of a place p, errors of variance 1 at all places leave residuals e of
covariance 1 - H there. The studentized residual,

    u = (1 - H)^(-1/2) e

has a covariance of 1 again, whatever the place (Cook and Weisberg 1982, Residuals and Influence
in Regression, 2.2; here of a place with all its visits). It lies between e and the leave-one-out
residual (1 - H)^-1 e. If errors vary smoothly over the places, e is too small, and (1 - H)^-1 e,
an error of extrapolation, is larger than the error between places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LEAST_FREE = 1e-9  # least eigenvalue of 1 - H; below it a fit reproduces any measurement


@dataclass(frozen=True)
class Known:
    """Information of data and priors about the unknowns z, (P,)."""

    information: Array  # (P, P) I, of the data
    along: Array  # (P,) b, S^T r of the data
    prior: Array  # (P,) diagonal of P, 0 for unknowns without prior

    @property
    def whole(self) -> Array:
        """Information of data and priors, A = I + P, (P, P)."""
        return self.information + np.diag(self.prior)

    def covariance(self, spread: float) -> Array:
        """Covariance of z (P, P): A^-1 (s I + P) A^-1.

        Args:
            spread: s; below 1 it counts as 1. It does not enlarge the uncertainty by priors.
        """
        inverse = np.linalg.inv(self.whole)
        known = max(1.0, spread) * self.information + np.diag(self.prior)
        return np.asarray(inverse @ known @ inverse)


def studentized(known: Known, slope: Array, residual: Array, place: Index) -> Array:
    """Compute the studentized residuals (n, d) of n poses.

    Args:
        known: information of all data.
        slope: whitened Jacobian of these poses, weighted as in `known`, (n, d, P).
        residual: whitened residuals at z = 0, weighted likewise, (n, d).
        place: (n,) of each pose; poses of one place are taken together.
    """
    inverse = np.linalg.inv(known.whole)
    error = residual - slope @ (inverse @ known.along)
    found = np.empty_like(residual)
    for number in np.unique(place):
        own = np.flatnonzero(place == number)
        flat = slope[own].reshape(-1, slope.shape[-1])
        free, way = np.linalg.eigh(np.eye(len(flat)) - flat @ inverse @ flat.T)
        root = np.sqrt(np.maximum(free, _LEAST_FREE))
        found[own] = (way / root @ (way.T @ error[own].reshape(-1))).reshape(error[own].shape)
    return found
