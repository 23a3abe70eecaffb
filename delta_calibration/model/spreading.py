"""Compiled spreading of samples onto a uniform grid, for non-uniform Fourier sums.

    sum_n y_n exp(i w q_n) = h / K(w) sum_g exp(i w x_g) sum_n k(x_g - q_n) y_n

with a kernel k that is zero beyond a few steps h and whose Fourier transform K is known: the
exponential of a semicircle (Barnett, Magland and af Klinteberg 2019, SIAM J. Sci. Comput. 41,
C479). Neglected is the aliasing of the kernel, by which a sum over a grid differs from an
integral.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled

Array = NDArray[np.float64]

STEPS = 16  # width of the kernel in steps of the grid
_SHARP = 2.3 * STEPS  # of the kernel; best where the shortest wave is four steps long


@compiled()
def kernel(x: float) -> float:
    """Kernel k at x, from -1 to 1 over its width."""
    return float(np.exp(_SHARP * (np.sqrt(max(0.0, 1.0 - x * x)) - 1.0)))


@compiled()
def spread(place: Array, columns: Array, begin: float, step: float, count: int) -> Array:
    """Spread columns onto the grid, (G, j).

    Args:
        place: position of each sample, (n,).
        columns: values of the samples, (n, j).
        begin: start of the grid; half a kernel before the first sample, or more.
        step: spacing of the grid.
        count: number of its points, G.
    """
    found = np.zeros((count, columns.shape[1]))
    for row in range(len(place)):
        at = (place[row] - begin) / step
        first = int(np.ceil(at - STEPS / 2))
        for point in range(first, first + STEPS):
            weight = kernel((point - at) * (2 / STEPS))
            for j in range(columns.shape[1]):
                found[point, j] += weight * columns[row, j]
    return found
