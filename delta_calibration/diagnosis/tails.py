"""How likely a sum of squares with weights of either sign is above nothing.

Q = sum_k l_k z_k^2 with z ~ N(0, 1) has the cumulants' function K(s) = -sum_k ln(1 - 2 s l_k) / 2,
and by its saddle point K'(s) = 0 (Lugannani and Rice 1980, Advances in Applied Probability 12,
475-490)

    P(Q > 0) = 1 - Phi(w) + phi(w) (1 / u - 1 / w),   w = sign(s) sqrt(-2 K),   u = s sqrt(K'')

within a tenth of itself, however far out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

Array = NDArray[np.float64]

_INSIDE = 1e-9  # share of the interval of s that is left at its ends
_MIDDLE = 1e-3  # w under which both terms in brackets are too large for their difference


def chance_above(weights: Array) -> float:
    """P(Q > 0).

    Args:
        weights: l, (k,), of any scale.
    """
    size = float(np.abs(weights).max(initial=0.0))
    if size == 0.0:
        return 1.0
    weights = weights / size
    if weights.min() >= 0.0 or weights.max() <= 0.0:
        return float(weights.min() >= 0.0)
    low, high = 1 / (2 * weights.min()), 1 / (2 * weights.max())
    margin = _INSIDE * (high - low)
    s = brentq(lambda s: np.sum(weights / (1 - 2 * s * weights)), low + margin, high - margin)
    left = 1 - 2 * s * weights
    value, bend = -np.log(left).sum() / 2, 2 * np.sum((weights / left) ** 2)
    w = np.sign(s) * np.sqrt(max(-2 * value, 0.0))
    if abs(w) < _MIDDLE:
        third = 8 * np.sum(weights**3) / (2 * np.sum(weights**2)) ** 1.5
        return float(0.5 - third / (6 * np.sqrt(2 * np.pi)))
    density = np.exp(-(w**2) / 2) / np.sqrt(2 * np.pi)
    return float(ndtr(-w) + density * (1 / (s * np.sqrt(bend)) - 1 / w))
