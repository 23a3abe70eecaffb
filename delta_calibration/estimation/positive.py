"""Linear equations whose matrix is positive definite."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

Array = NDArray[np.float64]


def solved(matrix: Array, right: Array) -> Array:
    """Solve a system that is positive definite up to rounding, (k,) or (k, j): half of LU's work.

    Raises:
        LinAlgError: the matrix is singular.
    """
    if not right.size:
        return right
    _, value, failed = dposv(matrix, right)
    return np.asarray(np.linalg.solve(matrix, right) if failed else value)
