"""Halton sequence: points that cover a box evenly, whatever their number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def halton(count: int, size: int, begin: int = 0) -> Array:
    """Points of the Halton sequence in the unit cube, (count, size).

    Coordinate d of point i has the digits of i in the base of the d-th prime, mirrored about the
    point: 6 = 110 in base 2 becomes 0.011. scipy.stats.qmc gives the same points, but takes a
    quarter of a second to load.

    Args:
        count: number of points.
        size: number of coordinates of a point.
        begin: index i of the first point.
    """
    points = np.zeros((count, size))
    for d, base in enumerate(_primes(size)):
        rest, weight = np.arange(begin, begin + count), 1.0 / base
        while rest.any():
            rest, digit = np.divmod(rest, base)
            points[:, d] += digit * weight
            weight /= base
    return points


def _primes(count: int) -> list[int]:
    """The first `count` primes."""
    found: list[int] = []
    number = 2
    while len(found) < count:
        if all(number % prime for prime in found):
            found.append(number)
        number += 1
    return found
