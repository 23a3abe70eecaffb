"""What every place is missed by when it is left out of a fit, to first order.

About a fit everything is linear in the unknowns z, r = S z + noise, with a prior of precision P.
Without a place p the data know I' = I - S_p^T S_p; then z' = A'^-1 (b - S_p^T r_p) with
A' = I' + P, the place is missed by r_p - S_p z', and the covariance of what was predicted of it is
S_p A'^-1 (s I' + P) A'^-1 S_p^T, with s by how much the noise is larger than was assumed.
(Allen 1974, Technometrics 16, 125-127: the residuals of PRESS, here of a place with all its
visits.)

No place is fitted anew (Woodbury). With the leverage H = S_p A^-1 S_p^T and F = (1 - H)^-1 it is
missed by F e, e by the fit to all, and the covariance is

    F H + (s - 1) F (S_p A^-1 I A^-1 S_p^T - H H) F
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
    inverse = np.linalg.inv(known.whole)
    wider = max(1.0, spread) - 1.0
    carried, error = slope @ inverse, residual - slope @ (inverse @ known.along)
    missed = np.empty_like(residual)
    covariance = np.empty((*residual.shape, residual.shape[1]))
    for number in np.unique(place):
        own = np.flatnonzero(place == number)
        flat, along = (each[own].reshape(-1, slope.shape[-1]) for each in (slope, carried))
        lever = along @ flat.T
        freed = np.linalg.inv(np.eye(len(flat)) - lever)
        missed[own] = (freed @ error[own].reshape(-1)).reshape(error[own].shape)
        known_of = along @ known.information @ along.T - lever @ lever
        whole = freed @ (lever + wider * known_of @ freed.T)
        shape = (len(own), residual.shape[1]) * 2
        covariance[own] = np.einsum("iaib->iab", whole.reshape(shape))
    return LeftOut(missed, covariance)
