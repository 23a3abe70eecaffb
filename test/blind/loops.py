"""Vector loops closed for many samples at once, by Newton's steps with numeric slopes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Gaps = Callable[[Array], Array]  # unknowns (n, k) -> what is left open (n, e) [m]

_STEP = 1e-6  # [m], [rad] of the differences
_CLOSED, _MOST = 1e-13, 40


def slopes(of: Gaps, at: Array) -> Array:
    """Central differences by each unknown, (n, e, k)."""
    sides = (
        (of(at + _STEP * axis) - of(at - _STEP * axis)) / (2 * _STEP)
        for axis in np.eye(at.shape[1])
    )
    return np.stack(list(sides), axis=-1)


def closed(gaps: Gaps, start: Array) -> Array:
    """Unknowns (n, k) at which the loops close, or come nearest to that where they cannot.

    Raises:
        ArithmeticError: they do not close from there.
    """
    x = start
    for _ in range(_MOST):
        open_by, slope = gaps(x), slopes(gaps, x)
        across = np.swapaxes(slope, 1, 2)
        step = np.linalg.solve(across @ slope, across @ open_by[..., None])[..., 0]
        x = x - step
        # where more loops than unknowns are left open a little, the last digits go round
        if np.abs(step).max() < (_CLOSED if slope.shape[1] == slope.shape[2] else 1e-11):
            return np.asarray(x)
    raise ArithmeticError(f"the loops do not close: last step {np.abs(step).max():.1e}")
