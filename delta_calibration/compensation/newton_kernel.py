"""Compiled Newton's method over a Delta's geometry: the steps of newton.py, row by row.

A step and the place it is tried at have their pose in common: it is found once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation import kernel
from delta_calibration.compensation.jit import compiled
from delta_calibration.compensation.kernel import Scratch

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Settings = tuple[float, float, float, int, int]  # of `NewtonSettings`, in its order
Room = tuple[Scratch, Array, Array, Array, Array, Array]


@compiled(None, kernel)
def _room() -> Room:
    """Places for one search, used again for all of a call."""
    return (
        kernel._scratch(),
        np.empty((6, 3)),  # U S over V of the Jacobian
        np.empty((3, 3)),  # [m/rad] Jacobian
        np.empty((3, 3)),  # [m] gap, and gap where a step is tried; [rad] step
        np.empty(3),  # [rad] correction that is tried
        np.empty(3),  # [rad] joints there
    )


@compiled()
def _descend(a: Array, gap: Array, step: Array) -> None:
    """The step -J^-1 gap (3,) [rad], by the U S over V of `_decompose`."""
    for k in range(3):
        step[k] = 0.0
    for j in range(3):
        square = a[0, j] ** 2 + a[1, j] ** 2 + a[2, j] ** 2
        share = (a[0, j] * gap[0] + a[1, j] * gap[1] + a[2, j] * gap[2]) / square
        for k in range(3):
            step[k] -= a[3 + k, j] * share


@compiled(None, kernel)
def _search(
    machine: tuple[Array, Array, Array],
    q: Array,
    target: Array,
    settings: Settings,
    best: Array,
    room: Room,
) -> tuple[float, int]:
    """Correct one command q (3,) [rad], from best (3,) [rad] = 0; distance [m], evaluations."""
    legs, rods, offset = machine
    bound, tolerance, condition_limit, iterations, halvings = settings
    scratch, a, slope, (gap, way, step), dq, there = room
    error, evaluations = kernel._distance(legs, rods, offset, q, target, gap, scratch), 1
    for _ in range(iterations):
        before = error
        if not tolerance < before < np.inf:
            break
        evaluations += 1
        # The pose in `scratch` is that of the best place: the last that was tried and taken.
        if not kernel._slope_here(legs, rods, offset, True, slope, scratch):
            break
        largest, smallest = kernel._decompose(slope, a)
        if not smallest * condition_limit > largest:
            break
        _descend(a, gap, step)
        for halving in range(halvings + 1):
            for k in range(3):
                dq[k] = min(max(best[k] + 0.5**halving * step[k], -bound), bound)
                there[k] = q[k] + dq[k]
            evaluations += 1
            far = kernel._distance(legs, rods, offset, there, target, way, scratch)
            if far < error:
                error = far
                for k in range(3):
                    best[k], gap[k] = dq[k], way[k]
                break
        if not error < before:
            break
    return error, evaluations


_GEOMETRY = "f8[:, ::1], f8[:, ::1], f8[::1]"  # legs, rods, offset: see kernel.py
_SETTINGS = "Tuple((f8, f8, f8, i8, i8))"


@compiled(
    "Tuple((f8[:, ::1], f8[::1], i8[::1]))"
    f"({_GEOMETRY}, f8[:, ::1], f8[:, ::1], {_SETTINGS})",
    kernel,
)
def newton(
    legs: Array, rods: Array, offset: Array, q: Array, target: Array, settings: Settings
) -> tuple[Array, Array, Counts]:
    """Corrections dq (n, 3) [rad], distances (n,) [m], evaluations (n,): see newton.py.

    For commands (n, 3) [rad] and targets (n, 3) [m].
    """
    n = len(q)
    best, error, evaluations = np.zeros((n, 3)), np.empty(n), np.empty(n, dtype=np.int64)
    machine, room = (legs, rods, offset), _room()
    for row in range(n):
        found = _search(machine, q[row], target[row], settings, best[row], room)
        error[row], evaluations[row] = found
    return best, error, evaluations
