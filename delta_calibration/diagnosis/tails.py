"""Tail probabilities of the distributions that a verdict needs.

They equal those of scipy.stats but use scipy.special, on which it is based: importing scipy.stats
takes a quarter of a second, for which every verb and node would wait.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, gammainc, gammaincc, ndtr, stdtr

Array = NDArray[np.float64]

_STRAIGHT = 1.6e-5  # skewness under which the normal distribution replaces Pearson's


def log_chi2(x: Array | float, k: float) -> Array:
    """ln of the probability that chi square of k degrees of freedom exceeds x."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(chdtrc(k, np.maximum(x, 0.0))))


def log_f(x: float, k: float, of_noise: float) -> float:
    """ln of the probability that Fisher's F of k and `of_noise` degrees of freedom exceeds x."""
    with np.errstate(divide="ignore"):
        return float(np.log(fdtrc(k, of_noise, max(x, 0.0))))


def log_t(x: float, k: float) -> float:
    """ln of the probability that Student's t of k degrees of freedom exceeds x."""
    with np.errstate(divide="ignore"):
        return float(np.log(stdtr(k, -x)))


def pearson3(x: float, skewness: float) -> float:
    """Probability that a Pearson type III variable of mean 0 and variance 1 exceeds x.

    It is a gamma distribution of shape a = 4 / skewness^2, shifted and scaled; mirrored if the
    skewness is negative.
    """
    if abs(skewness) < _STRAIGHT:
        return float(ndtr(-x))
    root = 2.0 / skewness
    beyond = gammaincc if skewness > 0 else gammainc
    return float(beyond(root**2, max(root * (x + root), 0.0)))


def moments(x: Array) -> tuple[float, float]:
    """Skewness and excess kurtosis of numbers (n,)."""
    off = x - x.mean()
    square = off**2
    variance = np.mean(square)
    return (
        float(np.mean(square * off) / variance**1.5),
        float(np.mean(square**2) / variance**2 - 3.0),
    )
