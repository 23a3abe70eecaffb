"""How likely it is that chance goes as far: tails of the laws that verdicts ask for.

Those of scipy.stats, by the functions of scipy.special that it rests on: loading scipy.stats takes
a quarter of a second, which every verb and node would wait for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, gammainc, gammaincc, ndtr, stdtr

Array = NDArray[np.float64]

_STRAIGHT = 1.6e-5  # skewness under which Pearson's law is taken for the normal one


def log_chi2(x: Array | float, k: float) -> Array:
    """ln p of chi square of k degrees of freedom that exceeds x."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(chdtrc(k, np.maximum(x, 0.0))))


def log_f(x: float, k: float, of_noise: float) -> float:
    """ln p of Fisher's F of k and `of_noise` degrees of freedom that exceeds x."""
    with np.errstate(divide="ignore"):
        return float(np.log(fdtrc(k, of_noise, max(x, 0.0))))


def log_t(x: float, k: float) -> float:
    """ln p of Student's t of k degrees of freedom that exceeds x."""
    with np.errstate(divide="ignore"):
        return float(np.log(stdtr(k, -x)))


def pearson3(x: float, skewness: float) -> float:
    """p of Pearson's law of type III, of mean 0 and variance 1, that exceeds x.

    A gamma law of shape a = 4 / skewness^2, shifted and scaled; turned round where it is skewed
    to the left.
    """
    if abs(skewness) < _STRAIGHT:
        return float(ndtr(-x))
    root = 2.0 / skewness
    beyond = gammaincc if skewness > 0 else gammainc
    return float(beyond(root**2, max(root * (x + root), 0.0)))


def moments(x: Array) -> tuple[float, float]:
    """Skewness of numbers (n,), and by how much their kurtosis exceeds a normal law's."""
    off = x - x.mean()
    square = off**2
    variance = np.mean(square)
    return (
        float(np.mean(square * off) / variance**1.5),
        float(np.mean(square**2) / variance**2 - 3.0),
    )
