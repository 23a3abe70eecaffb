"""Linear equations whose matrix is positive definite."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

Array = NDArray[np.float64]


def solved(matrix: Array, right: Array) -> Array:
    """Solution (k,) or (k, j) of what is positive definite but for rounding; half the work of LU.

    Raises:
        LinAlgError: the matrix is singular.
    """
    if not right.size:
        return right
    _, value, failed = dposv(matrix, right)
    return np.asarray(np.linalg.solve(matrix, right) if failed else value)
