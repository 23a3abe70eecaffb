"""Compiled lookup in a table of corrections: tricubic B-splines, all three joints at once.

On each axis, x from -1 to 1, the nodes are evenly spaced in x (1 + b x^2); with u in these steps

    dq(u) = sum_ijk B(u_1 - i) B(u_2 - j) B(u_3 - k) c_ijk

with B the cubic B-spline: 4 x 4 x 4 coefficients contribute at a command. A command with a joint
beyond the table, or one that is NaN, has no correction: NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled

Array = NDArray[np.float64]
Spline = tuple[int, float, float, float, float]


@compiled()
def _splines(q: float, axis: Array, last: int) -> Spline:
    """Index of the first of the four splines that contribute at q [rad], and their values."""
    x = (q - axis[2]) * axis[3]
    u = (x + axis[4] * x * x * x) * axis[5] + 0.5 * (last + 1)
    first = min(max(int(u), 0), last)
    t = u - first
    r = 1.0 - t
    return first, r * r * r / 6, 2 / 3 - t * t * (1 - t / 2), 2 / 3 - r * r * (1 - r / 2), t**3 / 6


@compiled("f8[:, ::1](f8[:, ::1], f8[:, :, :, ::1], f8[:, ::1])")
def look_up(axes: Array, coefficients: Array, q: Array) -> Array:
    """Corrections (n, 3) [rad] at joints q (n, 3) [rad].

    axes (3, 6): lower and upper end [rad], middle [rad], 1 / half the width [1/rad], b, and steps
    for one of x (1 + b x^2). coefficients (k + 2, k + 2, k + 2, 3) [rad], for k nodes an axis.
    """
    out, size, sums = np.empty((len(q), 3)), len(coefficients), np.empty(12)
    c = coefficients.reshape(-1)
    # Unsigned, as else the sign of every index is checked and the loop below not vectorised.
    one, two, three = np.uint64(3 * size), np.uint64(6 * size), np.uint64(9 * size)  # lines
    plane = np.uint64(3 * size * size)
    for row in range(len(q)):
        inside = True
        for k in range(3):
            inside = inside and axes[k, 0] <= q[row, k] <= axes[k, 1]
        if not inside:
            out[row, 0], out[row, 1], out[row, 2] = np.nan, np.nan, np.nan
            continue
        i, a0, a1, a2, a3 = _splines(q[row, 0], axes[0], size - 4)
        j, b0, b1, b2, b3 = _splines(q[row, 1], axes[1], size - 4)
        k, c0, c1, c2, c3 = _splines(q[row, 2], axes[2], size - 4)
        start = np.uint64(3 * ((i * size + j) * size + k))
        for at in range(np.uint64(12)):  # four splines of the third axis, three joints each
            p0 = start + at
            p1 = p0 + plane
            p2 = p1 + plane
            p3 = p2 + plane
            sums[at] = (
                a0 * (b0 * c[p0] + b1 * c[p0 + one] + b2 * c[p0 + two] + b3 * c[p0 + three])
                + a1 * (b0 * c[p1] + b1 * c[p1 + one] + b2 * c[p1 + two] + b3 * c[p1 + three])
                + a2 * (b0 * c[p2] + b1 * c[p2 + one] + b2 * c[p2 + two] + b3 * c[p2 + three])
                + a3 * (b0 * c[p3] + b1 * c[p3 + one] + b2 * c[p3 + two] + b3 * c[p3 + three])
            )
        for joint in range(3):
            out[row, joint] = (
                c0 * sums[joint]
                + c1 * sums[3 + joint]
                + c2 * sums[6 + joint]
                + c3 * sums[9 + joint]
            )
    return out
