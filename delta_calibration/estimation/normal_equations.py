"""Rows of the normal equations of a robust least-squares problem, compiled.

Each pose has a whitened residual r_i (d,) and rows A_i (d, F): the derivative of its prediction by
the unknowns z. Under a loss rho of the distance |r_i|, made for residuals of standard deviation s,

    cost = sum_i rho(|r_i|) / s^2 + sum_prior z_k^2        w_i = rho'(|r_i|) / (2 |r_i|)
    N = sum_i w_i A_i^T A_i / s^2 + P        b = sum_i w_i A_i^T r_i / s^2 - P z

with P diagonal, 1 for unknowns with a prior and 0 otherwise. The Gauss-Newton step is N^-1 b.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled

Array = NDArray[np.float64]

_WIDE, _SPARSE = 128, 0.3  # unknowns, and share of numbers that are not zero


@compiled()
def whitened(missed: Array, jacobian: Array, whiten: Array, basis: Array) -> tuple[Array, Array]:
    """Whitened residuals (n, d), and Jacobian rows (n d, F) by the unknowns.

    Args:
        missed: measured less predicted, (n, d).
        jacobian: d(predicted)/d(theta), (n, d, P).
        whiten: (n, d, d).
        basis: d(theta)/dz, (P, F).
    """
    n, d, count = jacobian.shape[0], jacobian.shape[1], basis.shape[1]
    residual, rows = np.zeros((n, d)), np.zeros((n * d, count))
    entry, unknown = np.nonzero(basis)  # nearly diagonal: a scale for each unknown
    size = np.array([basis[entry[i], unknown[i]] for i in range(len(entry))])
    scaled = np.empty((d, count))
    for row in range(n):
        scaled[:] = 0.0
        for j in range(d):
            for i in range(len(entry)):
                scaled[j, unknown[i]] += jacobian[row, j, entry[i]] * size[i]
        for i in range(d):
            for j in range(d):
                weight = whiten[row, i, j]
                if weight != 0.0:
                    residual[row, i] += weight * missed[row, j]
                    for k in range(count):
                        rows[row * d + i, k] += weight * scaled[j, k]
    return residual, rows


@compiled()
def judged(residual: Array, bend: float, cut: float, spread: float) -> tuple[Array, float]:
    """Weight of each pose (n,), and the cost of all residuals (n, d) under a loss.

    Args:
        residual: whitened.
        bend: distance from which the loss is linear.
        cut: distance from which the loss is constant and the weight 0.
        spread: standard deviation of the residuals that the loss is made for.
    """
    n, d = residual.shape
    weight, cost = np.ones(n), 0.0
    for row in range(n):
        square = 0.0
        for i in range(d):
            square += residual[row, i] ** 2
        distance = np.sqrt(square)
        if distance > bend:
            square = 2 * bend * min(distance, cut) - bend**2
            weight[row] = 0.0 if distance > cut else bend / distance
        cost += square
    return weight, cost / spread**2


@compiled()
def weighted(residual: Array, rows: Array, weight: Array, spread: float) -> tuple[Array, Array]:
    """Residuals (n d,) and rows (n d, F), times the root of the weight and over `spread`.

    Args:
        residual: (n, d).
        rows: (n d, F).
        weight: of each pose, (n,).
        spread: standard deviation of the residuals that the loss is made for.
    """
    n, d = residual.shape
    scaled, error = np.empty_like(rows), np.empty(n * d)
    for row in range(n):
        root = np.sqrt(weight[row]) / spread
        for i in range(row * d, row * d + d):
            error[i] = root * residual[row, i - row * d]
            for k in range(rows.shape[1]):
                scaled[i, k] = root * rows[i, k]
    return error, scaled


def products(residual: Array, rows: Array, weight: Array, spread: float) -> tuple[Array, Array]:
    """A' W A (F, F) and A' W r (F,) of samples, without priors; arguments as of `weighted`.

    Error curves are zero at most samples: leaving their zeros out takes less time.
    """
    if rows.shape[1] > _WIDE and np.count_nonzero(rows) < _SPARSE * rows.size:
        inner, along = _sparse_products(residual, rows, weight, spread)
        return inner + np.tril(inner, -1).T, along
    error, scaled = weighted(residual, rows, weight, spread)
    return scaled.T @ scaled, scaled.T @ error


@compiled()
def _sparse_products(
    residual: Array, rows: Array, weight: Array, spread: float
) -> tuple[Array, Array]:
    """The same without the zeros; of A' W A only the lower half is filled."""
    n, d = residual.shape
    count = rows.shape[1]
    inner, along = np.zeros((count, count)), np.zeros(count)
    used, own, line = np.empty(count, dtype=np.int64), np.empty((d, count)), np.empty(count)
    for row in range(n):
        root = np.sqrt(weight[row]) / spread
        busy = 0
        for k in range(count):
            shows = False
            for i in range(d):
                own[i, busy] = root * rows[row * d + i, k]
                shows = shows or own[i, busy] != 0.0
            if shows:
                used[busy] = k
                busy += 1
        for a in range(busy):
            for i in range(d):
                along[used[a]] += own[i, a] * root * residual[row, i]
            line[: a + 1] = own[0, a] * own[0, : a + 1]
            for i in range(1, d):
                for b in range(a + 1):
                    line[b] += own[i, a] * own[i, b]
            for b in range(a + 1):
                inner[used[a], used[b]] += line[b]
    return inner, along
