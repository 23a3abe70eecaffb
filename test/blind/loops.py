"""Loop closures for many samples at once, by Newton's method with numeric derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Gaps = Callable[[Array], Array]  # unknowns (n, k) -> closure errors (n, e) [m]

_STEP = 1e-6  # [m], [rad] step of finite differences
_CLOSED, _MOST = 1e-13, 40


def slopes(of: Gaps, at: Array) -> Array:
    """Central differences by each unknown, (n, e, k)."""
    sides = (
        (of(at + _STEP * axis) - of(at - _STEP * axis)) / (2 * _STEP)
        for axis in np.eye(at.shape[1])
    )
    return np.stack(list(sides), axis=-1)


def closed(gaps: Gaps, start: Array) -> Array:
    """Unknowns (n, k) that close the loops, or fit best where the loops cannot close.

    Raises:
        ArithmeticError: there is no convergence from this start.
    """
    x = start
    for _ in range(_MOST):
        open_by, slope = gaps(x), slopes(gaps, x)
        across = np.swapaxes(slope, 1, 2)
        step = np.linalg.solve(across @ slope, across @ open_by[..., None])[..., 0]
        x = x - step
        # With more loops than unknowns some error remains, and the last digits do not settle.
        if np.abs(step).max() < (_CLOSED if slope.shape[1] == slope.shape[2] else 1e-11):
            return np.asarray(x)
    raise ArithmeticError(f"the loops do not close: last step {np.abs(step).max():.1e}")
