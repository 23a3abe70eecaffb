"""Samples laid on an even grid, for sums of waves over them, compiled.

    sum_n y_n exp(i w q_n) = h / K(w) sum_g exp(i w x_g) sum_n k(x_g - q_n) y_n

with a kernel k that is nothing beyond a few steps h and whose transform K is known: the
exponential of a semicircle (Barnett, Magland and af Klinteberg 2019, SIAM J. Sci. Comput. 41,
C479). What is left out are the kernel's echoes, by which the sum of a grid differs from an
integral.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled

Array = NDArray[np.float64]

STEPS = 16  # of the grid that the kernel reaches over
_SHARP = 2.3 * STEPS  # best where the shortest wave is four steps long


@compiled()
def kernel(x: float) -> float:
    """k at x from -1 to 1, its ends."""
    return float(np.exp(_SHARP * (np.sqrt(max(0.0, 1.0 - x * x)) - 1.0)))


@compiled()
def spread(place: Array, columns: Array, begin: float, step: float, count: int) -> Array:
    """Columns on the grid, (G, j).

    Args:
        place: of each sample, (n,).
        columns: (n, j).
        begin: of the grid; half a kernel before the first sample, or more.
        step: of the grid.
        count: of its points, G.
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
