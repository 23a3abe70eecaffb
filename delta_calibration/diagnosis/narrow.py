"""Products with few columns, compiled.

A library's matrix product copies both factors into blocks first. That pays if both are wide; with
a few columns on one side the copies take longer than the product, which reads each number once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FEW = 6  # columns up to which this is faster
_LEAST = 30_000  # numbers on the other side from which it is


def along(few: Array, many: Array) -> Array:
    """Products few' many of columns, few (n, k) and many (n, j), (k, j)."""
    if few.shape[1] > FEW or many.size < _LEAST or not many.flags.c_contiguous:
        return np.asarray(few.T @ many)
    return np.asarray(_along(np.ascontiguousarray(few), many))


@compiled("float64[:,::1](float64[:,::1], float64[:,::1])", contract=True)
def _along(few: Array, many: Array) -> Array:
    """The products, four rows at a time."""
    n, k = few.shape
    width, whole = many.shape[1], n - n % 4
    found = np.zeros((k, width))
    for begin in range(0, whole, 4):
        a, b, c, d = many[begin], many[begin + 1], many[begin + 2], many[begin + 3]
        for i in range(k):
            own = found[i]
            p, q = few[begin, i], few[begin + 1, i]
            r, s = few[begin + 2, i], few[begin + 3, i]
            for j in range(width):
                own[j] += p * a[j] + q * b[j] + r * c[j] + s * d[j]
    for row in range(whole, n):
        for i in range(k):
            for j in range(width):
                found[i, j] += few[row, i] * many[row, j]
    return found


@compiled(
    "float64[:,::1](float64[:,::1], int64[:,::1], float64[::1], float64[::1])", contract=True
)
def seen(x: Array, spans: Index, own: Array, root: Array) -> Array:
    """Products S B^T x of columns x (d n, k) with the blocks of a covariance, (r, k) in all.

    Args:
        x: the columns.
        spans: of each block its first row of x, the row behind its last one, and its r, (E, 3).
        own: B of each block, (rows, r), one after the other, flattened.
        root: S of each block, (r, r), likewise.
    """
    k = x.shape[1]
    found = np.zeros((np.sum(spans[:, 2]), k))
    first, at_own, at_root = 0, 0, 0
    for block in range(len(spans)):
        begin, end, size = spans[block]
        along = np.zeros((k, size))
        for row in range(begin, end):
            columns = own[at_own : at_own + size]
            at_own += size
            for j in range(k):
                value, sums = x[row, j], along[j]
                for i in range(size):
                    sums[i] += value * columns[i]
        for i in range(size):
            weights = root[at_root : at_root + size]
            at_root += size
            for j in range(k):
                for part in range(size):
                    found[first + i, j] += weights[part] * along[j, part]
        first += size
    return found
