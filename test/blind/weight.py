"""Forces in the machine, all from energies and mass points of its own kinematics.

No torque or force formula: gravity's moment at a joint is how the potential energy changes when
the joint turns, a rod's tension how it changes when the rod is longer, and the moment of inertia
forces the work they do on what every mass point would move by (D'Alembert).
"""

from __future__ import annotations

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


def inertia(
    q: Array,
    velocity: Array,
    acceleration: Array,
    build: Build,
    payload: Array,
    centre: Array,
    near: Stand,
) -> Array:
    """Moment that each joint must give to move the masses as commanded, (n, 3) [N m]."""

    def where(angle: Array) -> Array:
        return mass_points(assemble(angle, build, None, near), build, payload, centre)[1]

    t = _MOMENT
    later, sooner = (q + s * t * velocity + t**2 / 2 * acceleration for s in (1, -1))
    mass, here = mass_points(assemble(q, build, None, near), build, payload, centre)
    pushed = mass[..., None] * (where(later) - 2 * here + where(sooner)) / t**2
    each = []
    for joint in np.eye(3):
        slope = (where(q + _TURN * joint) - where(q - _TURN * joint)) / (2 * _TURN)
        each.append(np.sum(pushed * slope, axis=(1, 2)))
    return np.stack(each, axis=1)
