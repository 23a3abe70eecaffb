"""Loads of a machine, all from energies and mass points of its own kinematics.

No torque or force formula: gravity's moment at a joint is how the potential energy changes when
the joint turns, and the moment of inertia forces the work they do on what every mass point would
move by (D'Alembert).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.kind import Kind

Array = NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2]
_TURN, _MOMENT = 1e-4, 2e-3  # [rad of a Delta], [s] steps of the differences


def energy(kind: Kind, stand: Any, build: Any, payload: Array, centre: Array) -> Array:
    """Potential energy of all that moves, (n,) [J]."""
    mass, where = kind.masses(stand, build, payload, centre)
    return GRAVITY * np.sum(mass * where[..., 2], axis=1)


def torques(
    kind: Kind, q: Array, build: Any, changed: Any, payload: Array, centre: Array, near: Any
) -> Array:
    """What gravity does against each joint, dE/dq, (n, m) [N m], or [N]."""
    each, turn = [], _TURN * kind.size
    for joint in np.eye(q.shape[1]):
        up, down = (
            energy(
                kind,
                kind.assemble(q + s * turn * joint, build, changed, near),
                build,
                payload,
                centre,
            )
            for s in (1, -1)
        )
        each.append((up - down) / (2 * turn))
    return np.stack(each, axis=1)


def inertia(
    kind: Kind,
    q: Array,
    velocity: Array,
    acceleration: Array,
    build: Any,
    payload: Array,
    centre: Array,
    near: Any,
) -> Array:
    """Moment that each joint must give to move the masses as commanded, (n, m) [N m], or [N]."""

    def where(angle: Array) -> Array:
        stand = kind.assemble(angle, build, None, near)
        return kind.masses(stand, build, payload, centre)[1]

    t, turn = _MOMENT, _TURN * kind.size
    later, sooner = (q + s * t * velocity + t**2 / 2 * acceleration for s in (1, -1))
    mass, here = kind.masses(kind.assemble(q, build, None, near), build, payload, centre)
    pushed = mass[..., None] * (where(later) - 2 * here + where(sooner)) / t**2
    each = []
    for joint in np.eye(q.shape[1]):
        slope = (where(q + turn * joint) - where(q - turn * joint)) / (2 * turn)
        each.append(np.sum(pushed * slope, axis=(1, 2)))
    return np.stack(each, axis=1)
