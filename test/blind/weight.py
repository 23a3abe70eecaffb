"""Loads of a machine, all from energies and mass points of its own kinematics.

There is no formula for torques or forces: the gravity torque of a joint is the derivative of the
potential energy by its angle, and an inertia torque is the work of the inertia forces on the
displacements of all mass points (D'Alembert).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.kind import Kind

Array = NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2]
_TURN, _MOMENT = 1e-4, 2e-3  # [rad of a Delta], [s] steps of finite differences


def energy(kind: Kind, stand: Any, build: Any, payload: Array, centre: Array) -> Array:
    """Potential energy of all moving masses, (n,) [J]."""
    mass, where = kind.masses(stand, build, payload, centre)
    return GRAVITY * np.sum(mass * where[..., 2], axis=1)


def torques(
    kind: Kind, q: Array, build: Any, changed: Any, payload: Array, centre: Array, near: Any
) -> Array:
    """Gravity torque against each joint, dE/dq, (n, m) [N m], or [N]."""
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


@dataclass(frozen=True)
class Moved:
    """Samples in motion: commanded motion and payload."""

    kind: Kind
    q: Array  # (n, m) [rad]
    velocity: Array  # (n, m) [rad/s]
    acceleration: Array  # (n, m) [rad/s^2]
    build: Any
    payload: Array  # (n,) [kg]
    centre: Array  # (3,) [m]
    near: Any

    def where(self, q: Array, changed: Any = None) -> Array:
        """Positions of the masses, (n, k, 3) [m]."""
        stand = self.kind.assemble(q, self.build, changed, self.near)
        return self.kind.masses(stand, self.build, self.payload, self.centre)[1]

    @cached_property
    def pushed(self) -> Array:
        """Force that accelerates each mass as commanded, (n, k, 3) [N]."""
        t = _MOMENT
        ways = (t * s * self.velocity + t**2 / 2 * self.acceleration for s in (1, -1))
        later, sooner = (self.where(self.q + way) for way in ways)
        stand = self.kind.assemble(self.q, self.build, None, self.near)
        mass, here = self.kind.masses(stand, self.build, self.payload, self.centre)
        return mass[..., None] * (later - 2 * here + sooner) / t**2

    def moments(self) -> Array:
        """Joint torque for that force, (n, m) [N m], or [N]."""
        each, turn = [], _TURN * self.kind.size
        for joint in np.eye(self.q.shape[1]):
            up, down = (self.where(self.q + s * turn * joint) for s in (1, -1))
            each.append(self.work(up, down) / (2 * turn))
        return np.stack(each, axis=1)

    def work(self, up: Array, down: Array) -> Array:
        """Work of the forces from one position of the masses to another, (n,) [J]."""
        return np.asarray(np.sum(self.pushed * (up - down), axis=(1, 2)))
