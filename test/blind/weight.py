"""Forces in the machine, all from energies and mass points of its own kinematics.

No torque or force formula: gravity's moment at a joint is how the potential energy changes when
the joint turns, a rod's tension how it changes when the rod is longer, and the moment of inertia
forces the work they do on what every mass point would move by (D'Alembert).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blind.machine import Build, Changed, Stand, assemble

Array = NDArray[np.float64]

PLATFORM_KG, ARM_KG, ROD_KG = 1.2, 1.6, 0.18
ARM_CENTRE = 0.45  # of its length from the motor's axis
GRAVITY = 9.81  # [m/s^2]
_TURN, _LONGER, _MOMENT = 1e-4, 1e-5, 2e-3  # [rad], [m], [s] steps of the differences


def mass_points(stand: Stand, build: Build, payload: Array, centre: Array) -> tuple[Array, Array]:
    """Masses (n, 17) [kg] and where they are (n, 17, 3) [m].

    A rod is three points: with 1/6, 2/3, 1/6 of its mass at its ends and middle, weight, moments
    and kinetic energy are those of a uniform rod.
    """
    n = len(stand.place)
    foot = build.arms[2].mean(axis=1)
    arms = foot + ARM_CENTRE * (stand.arms - foot)
    upper, lower = stand.elbows.reshape(n, 6, 3), stand.ends().reshape(n, 6, 3)
    where = np.concatenate(
        [
            stand.place[:, None],
            stand.point(centre)[:, None],
            arms,
            upper,
            (upper + lower) / 2,
            lower,
        ],
        axis=1,
    )
    fixed = [ARM_KG] * 3 + [ROD_KG / 6] * 6 + [ROD_KG * 2 / 3] * 6 + [ROD_KG / 6] * 6
    mass = np.empty((n, where.shape[1]))
    mass[:, 0], mass[:, 1], mass[:, 2:] = PLATFORM_KG, payload, fixed
    return mass, where


def energy(stand: Stand, build: Build, payload: Array, centre: Array) -> Array:
    """Potential energy of all that moves, (n,) [J]."""
    mass, where = mass_points(stand, build, payload, centre)
    return GRAVITY * np.sum(mass * where[..., 2], axis=1)


def torques(
    q: Array, build: Build, changed: Changed, payload: Array, centre: Array, near: Stand
) -> Array:
    """What gravity does against each joint, dE/dq, (n, 3) [N m]."""
    each = []
    for joint in np.eye(3):
        up, down = (
            energy(assemble(q + s * _TURN * joint, build, changed, near), build, payload, centre)
            for s in (1, -1)
        )
        each.append((up - down) / (2 * _TURN))
    return np.stack(each, axis=1)


def tensions(
    q: Array, build: Build, changed: Changed, payload: Array, centre: Array, near: Stand
) -> Array:
    """Tension of each rod, -dE/dl with the joints held, (n, 3, 2) [N]."""
    result = np.zeros((len(q), 6))
    for rod in range(6):
        longer = _LONGER * np.eye(6)[rod].reshape(1, 3, 2)
        up, down = (
            energy(assemble(q, build, changed.and_rod(s * longer), near), build, payload, centre)
            for s in (1, -1)
        )
        result[:, rod] = -(up - down) / (2 * _LONGER)
    return result.reshape(-1, 3, 2)


@dataclass(frozen=True)
class Moved:
    """Samples in motion: what was commanded of a machine, and what it carried."""

    q: Array  # (n, 3) [rad]
    velocity: Array  # (n, 3) [rad/s]
    acceleration: Array  # (n, 3) [rad/s^2]
    build: Build
    payload: Array  # (n,) [kg]
    centre: Array  # (3,) [m]
    near: Stand

    def where(self, q: Array, changed: Changed | None = None) -> Array:
        """Places of the masses, (n, 17, 3) [m]."""
        stand = assemble(q, self.build, changed, self.near)
        return mass_points(stand, self.build, self.payload, self.centre)[1]

    @cached_property
    def pushed(self) -> Array:
        """Force that moves each mass as commanded, (n, 17, 3) [N]."""
        t = _MOMENT
        ways = (t * s * self.velocity + t**2 / 2 * self.acceleration for s in (1, -1))
        later, sooner = (self.where(self.q + way) for way in ways)
        mass, here = mass_points(
            assemble(self.q, self.build, None, self.near), self.build, self.payload, self.centre
        )
        return mass[..., None] * (later - 2 * here + sooner) / t**2

    def moments(self) -> Array:
        """Moment that each joint must give for it, (n, 3) [N m]."""
        each = []
        for joint in np.eye(3):
            ends = (self.where(self.q + s * _TURN * joint) for s in (1, -1))
            each.append(self._work(*ends) / (2 * _TURN))
        return np.stack(each, axis=1)

    def tensions(self) -> Array:
        """Tension that each rod must give for it, (n, 3, 2) [N]."""
        each = []
        for rod in np.eye(6).reshape(6, 1, 3, 2):
            ends = (
                self.where(self.q, Changed.nothing().and_rod(s * _LONGER * rod)) for s in (1, -1)
            )
            each.append(-self._work(*ends) / (2 * _LONGER))
        return np.stack(each, axis=1).reshape(-1, 3, 2)

    def _work(self, up: Array, down: Array) -> Array:
        return np.asarray(np.sum(self.pushed * (up - down), axis=(1, 2)))
