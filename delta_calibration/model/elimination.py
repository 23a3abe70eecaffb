"""Compiled elimination for the small systems of a mechanism, in arrays that are given.

A system has its right-hand sides behind its columns. `triangles` and `halved` keep their factors,
for any number of right-hand sides that come later.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled

Array = NDArray[np.float64]


@compiled(borrows=True)
def solve(system: Array, size: int, sides: int) -> bool:
    """Solve `size` equations for the right-hand sides behind them, in place; False if singular."""
    width = size + sides
    for k in range(size):
        best, most = k, abs(system[k, k])
        for i in range(k + 1, size):
            other = abs(system[i, k])
            if other > most:
                best, most = i, other
        if not most > 0.0:  # zero or NaN
            return False
        own = system[k]
        if best != k:
            row = system[best]
            for j in range(k, width):
                own[j], row[j] = row[j], own[j]
        inverse = 1.0 / own[k]
        for i in range(k + 1, size):
            row = system[i]
            factor = row[k] * inverse
            if factor != 0.0:
                for j in range(k + 1, width):
                    row[j] -= factor * own[j]
    _solve_upper(system, size, sides)
    return True


@compiled(borrows=True)
def solve_definite(system: Array, size: int, sides: int) -> bool:
    """Solve as `solve` a symmetric, positive definite system; only its upper half is read."""
    width = size + sides
    for k in range(size):
        own = system[k]
        if not own[k] > 0.0:  # zero, below it by rounding, or NaN
            return False
        inverse = 1.0 / own[k]
        for i in range(k + 1, size):
            row = system[i]
            factor = own[i] * inverse
            for j in range(i, width):
                row[j] -= factor * own[j]
    _solve_upper(system, size, sides)
    return True


@compiled(borrows=True)
def _solve_upper(system: Array, size: int, sides: int) -> None:
    """Solve an upper triangular system for the right-hand sides behind it, in place."""
    for k in range(size - 1, -1, -1):
        own = system[k]
        inverse = 1.0 / own[k]
        for side in range(size, size + sides):
            total = own[side]
            for j in range(k + 1, size):
                total -= own[j] * system[j, side]
            own[side] = total * inverse


@compiled(borrows=True)
def squares(slope: Array, system: Array) -> None:
    """Upper half of slope^T slope of slope (r, k), into the first columns of `system`."""
    r, k = slope.shape
    for i in range(k):
        for j in range(i, k):
            total = 0.0
            for row in range(r):
                total += slope[row, i] * slope[row, j]
            system[i, j] = total


@compiled(borrows=True)
def _normal_equations(slope: Array, f: Array, system: Array) -> None:
    """Upper half of slope^T slope, and slope^T f of f (r,) behind it, into `system`."""
    r, k = slope.shape
    squares(slope, system)
    for i in range(k):
        total = 0.0
        for row in range(r):
            total += slope[row, i] * f[row]
        system[i, k] = total


@compiled(borrows=True)
def normal_step(slope: Array, f: Array, system: Array, step: Array) -> bool:
    """The step (J^T J)^-1 J^T f; False if J is rank deficient."""
    count = slope.shape[1]
    _normal_equations(slope, f, system)
    if not solve_definite(system, count, 1):
        return False
    for i in range(count):
        step[i] = system[i, count]
    return True


@compiled(borrows=True)
def least_step(slope: Array, f: Array, damping: float, system: Array, step: Array) -> bool:
    """The step J^T (J J^T + damping)^-1 f, or J^-1 f where J is square and nothing is damped."""
    r, count = slope.shape
    if r == count and damping == 0.0:
        for i in range(r):
            for j in range(r):
                system[i, j] = slope[i, j]
            system[i, r] = f[i]
        if not solve(system, r, 1):
            return False
        for i in range(r):
            step[i] = system[i, r]
        return True
    for i in range(r):
        for j in range(r):
            total = 0.0
            for u in range(count):
                total += slope[i, u] * slope[j, u]
            system[i, j] = total
        system[i, i] += damping + 2.3e-16
        system[i, r] = f[i]
    if not solve(system, r, 1):  # with pivoting: rank deficient if closures outnumber unknowns
        return False
    for j in range(count):
        total = 0.0
        for i in range(r):
            total += slope[i, j] * system[i, r]
        step[j] = total
    return True


@compiled(borrows=True)
def triangles(factor: Array, size: int) -> bool:
    """P A = L U in place; behind it the row exchanges, and one over the diagonal of U."""
    for k in range(size):
        best, most = k, abs(factor[k, k])
        for i in range(k + 1, size):
            other = abs(factor[i, k])
            if other > most:
                best, most = i, other
        if not most > 0.0:  # zero or NaN
            return False
        own = factor[k]
        if best != k:
            row = factor[best]
            for j in range(size):
                own[j], row[j] = row[j], own[j]
        inverse = 1.0 / own[k]
        own[size], own[size + 1] = best, inverse
        for i in range(k + 1, size):
            row = factor[i]
            share = row[k] * inverse
            row[k] = share
            if share != 0.0:
                for j in range(k + 1, size):
                    row[j] -= share * own[j]
    return True


@compiled(borrows=True)
def halved(factor: Array, size: int) -> bool:
    """A = U^T D^-1 U in place, for a symmetric, positive definite A by its upper half."""
    for k in range(size):
        own = factor[k]
        if not own[k] > 0.0:  # zero, below it by rounding, or NaN
            return False
        inverse = 1.0 / own[k]
        own[size + 1] = inverse
        for i in range(k + 1, size):
            row = factor[i]
            share = own[i] * inverse
            for j in range(i, size):
                row[j] -= share * own[j]
    return True


@compiled(borrows=True)
def down(factor: Array, size: int, values: Array) -> None:
    """Solve for values (size,) in place, after `triangles`."""
    for i in range(size):
        best = int(factor[i, size])
        values[i], values[best] = values[best], values[i]
    for i in range(1, size):
        row, total = factor[i], values[i]
        for j in range(i):
            total -= row[j] * values[j]
        values[i] = total
    _up(factor, size, values)


@compiled(borrows=True)
def down_half(factor: Array, size: int, values: Array) -> None:
    """Solve for values (size,) in place, after `halved`."""
    for k in range(size):
        own = factor[k]
        value = values[k] * own[size + 1]
        for i in range(k + 1, size):
            values[i] -= own[i] * value
    _up(factor, size, values)


@compiled(borrows=True)
def _up(factor: Array, size: int, values: Array) -> None:
    """Solve for values (size,) in place by the upper triangle."""
    for k in range(size - 1, -1, -1):
        own, total = factor[k], values[k]
        for j in range(k + 1, size):
            total -= own[j] * values[j]
        values[k] = total * own[size + 1]


@compiled(borrows=True)
def across(factor: Array, size: int, values: Array) -> None:
    """Solve for values (size,) in place by the transpose, after `triangles`."""
    for k in range(size):
        own = factor[k]
        values[k] *= own[size + 1]
        value = values[k]
        for j in range(k + 1, size):
            values[j] -= own[j] * value
    for k in range(size - 1, 0, -1):
        own, value = factor[k], values[k]
        for j in range(k):
            values[j] -= own[j] * value
    for i in range(size - 1, -1, -1):
        best = int(factor[i, size])
        values[i], values[best] = values[best], values[i]
