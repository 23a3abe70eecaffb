"""Compiled functions that a test translates to C, and some that cannot be translated."""

from __future__ import annotations

import numpy as np

from delta_calibration.model.jit import compiled

Array = np.ndarray


@compiled(borrows=True)
def _ends(values: Array, first: int) -> tuple[float, int]:
    """Two numbers of different types, computed from the rest of an array."""
    part = values[first:]
    return part[0] - part[len(part) - 1], len(part)


@compiled(borrows=True)
def everything(rows: Array, out: Array, settings: Array) -> float:
    """All constructs of the chain's loops, in few lines."""
    total, least, scale = 0, np.inf, 2
    m, k = rows.shape
    for row in rows:
        for value in row:
            least = min(least, value, 3.0) if -1.0 < value <= settings[0] else least
    for i in range(m - 1, -1, -1):
        if i == 1 and not settings[1] > 0.0:
            continue
        total += i
    while total > 2:
        total -= 1
    total += len(rows[1:m]) + int(rows[1:m][0, 0] < rows[1, 0])
    gap, count = _ends(rows[0], 1)
    out[:] = gap / scale
    out[0], out[1] = out[1] + total, out[0] - count
    own = rows[m - 1]
    own[k - 1] += 0.0
    held = own if settings[1] > 0.0 else settings
    out[2] = held[0] ** 2 + 0.5**count + total / scale + max(m, k)
    return float(np.sqrt(abs(least)))


@compiled(borrows=True)
def remaining(values: Array) -> None:
    """A remainder, whose sign differs in C."""
    values[0] = len(values) % 3


@compiled(borrows=True)
def undecided(values: Array) -> float:
    """A name with two types."""
    part = values[0]
    part = values[1:]
    return float(part[0])


@compiled(borrows=True)
def listing(values: Array) -> float:
    """A loop over literal numbers."""
    total = 0.0
    for side in (-1.0, 1.0):
        total += side * values[0]
    return total
