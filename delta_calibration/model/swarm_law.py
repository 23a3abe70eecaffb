"""Inertia of a swarm by its diversity: Pan, Qiu, Liu (2017), see apso.py, (11)-(14).

For a swarm of m particles whose positions along the diagonal of the search box are y in [-1, 1],
counted in m equal bins of which bin b holds h_b:

    E = -sum q_b ln q_b / ln m,  q_b = h_b / m        w = 1 / (1 + 1.5 exp(-2.6 E))

The paper does not divide E by ln m; (14) requires E in [0, 1].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def diversity(along: Array) -> Array:
    """Return E (n,) of n swarms by their particles' positions along the diagonal, (n, m)."""
    n, m = along.shape
    bins = np.clip(np.floor((along + 1.0) * (0.5 * m)).astype(np.int64), 0, m - 1)
    places = bins + m * np.arange(n)[:, None]
    counts = np.bincount(places.ravel(), minlength=n * m).reshape(n, m)
    return np.asarray(np.sum(entropy_terms(m)[counts], axis=1) / np.log(m))


def inertia(entropy: Array) -> Array:
    """Return the weight w of (14): 0.4 for a swarm in one place, 0.9 for one spread evenly."""
    return np.asarray(1.0 / (1.0 + 1.5 * np.exp(-2.6 * entropy)))


def entropy_terms(m: int) -> Array:
    """Return -q ln q, q = h / m, of a bin with h = 0..m of the m particles; 0 for an empty one."""
    q = np.arange(m + 1) / m
    return -q * np.log(np.where(q > 0.0, q, 1.0))
