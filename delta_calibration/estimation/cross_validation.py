"""Residuals of a fit as they would be had it taken up nothing of them, to first order.

About a fit everything is linear in the unknowns z, r = S z + noise, with a prior of precision P.
A fit takes up a part of what it cannot explain: with A = S^T S + P and the leverage
H = S_p A^-1 S_p^T of a place p, errors of variance 1 at all places leave residuals e of covariance
1 - H there. Studentized,

    u = (1 - H)^(-1/2) e

has a covariance of 1 again, whatever the place (Cook and Weisberg 1982, Residuals and Influence
in Regression, 2.2; here of a place with all its visits). It lies between e and what the place is
missed by when it is left out, (1 - H)^-1 e: where errors go smoothly over the places the one is
too small, and the other is how far a fit reaches outwards, more than it misses between places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LEAST_FREE = 1e-9  # of 1 - H, below which a fit goes through whatever was measured


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

    def covariance(self, spread: float) -> Array:
        """Of z (P, P): A^-1 (s I + P) A^-1.

        Args:
            spread: s, at least 1. What only the priors know is as uncertain as before.
        """
        inverse = np.linalg.inv(self.whole)
        known = max(1.0, spread) * self.information + np.diag(self.prior)
        return np.asarray(inverse @ known @ inverse)


def studentized(known: Known, slope: Array, residual: Array, place: Index) -> Array:
    """Residuals (n, d) of n poses, as large as what the fit did not know.

    Args:
        known: by all data.
        slope: of these poses, as they are in `known`, (n, d, P), whitened.
        residual: at z = 0, (n, d), whitened.
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
