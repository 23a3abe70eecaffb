"""A rotary Delta of six separate rods, solved for many samples at once.

Ball joints are points, a rod is a distance between two of them, the platform lies where all six
distances are right: Newton's method on distances (not on their squares), the platform turned from
the left by small rotations. Whatever may change from sample to sample (a rod that stretches, an arm
that grows) is an argument of the solution, not of the machine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

RADIUS, PLATFORM, ARM, ROD, HALF = 0.2, 0.055, 0.32, 0.85, 0.04  # [m] SRBD
PLATFORM_KG, ARM_KG, ARM_CENTRE, ROD_KG = 1.2, 1.6, 0.45, 0.18
GRAVITY = 9.81  # [m/s^2]
SIDES = np.array([-1.0, 1.0])
LEGS: Array = Rotation.from_rotvec(
    np.array([[0.0, 0.0, 2 * np.pi / 3 * leg] for leg in range(3)])
).as_matrix()


@dataclass(frozen=True)
class Build:
    """How a machine was built; lengths [m], angles [rad]; one row a leg."""

    hinge: Array  # (3, 3) of the motor's axis, in the leg's directions
    tilt: Array  # (3, 3) rotation vector of the hinge
    zero: Array  # (3,)
    arm: Array  # (3,)
    rod: Array  # (3, 2)
    elbow: Array  # (3, 2) ball joint from the middle of its pair
    elbow_line: Array  # (3, 3) rotation vector of the pair's line, in the hinge's directions
    platform: Array  # (3, 3) middle of the platform's pair, in the leg's directions
    ball: Array  # (3, 2)
    platform_line: Array  # (3, 3)


def drawing() -> Build:
    """The machine as drawn."""
    return Build(
        hinge=np.tile([RADIUS, 0.0, 0.0], (3, 1)),
        tilt=np.zeros((3, 3)),
        zero=np.zeros(3),
        arm=np.full(3, ARM),
        rod=np.full((3, 2), ROD),
        elbow=np.full((3, 2), HALF),
        elbow_line=np.zeros((3, 3)),
        platform=np.tile([PLATFORM, 0.0, 0.0], (3, 1)),
        ball=np.full((3, 2), HALF),
        platform_line=np.zeros((3, 3)),
    )


def manufactured(rng: np.random.Generator, scatter: float) -> Build:
    """A machine as built: every part off by `scatter` times a good workshop's tolerance."""
    no_y = np.array([1.0, 0.0, 1.0])

    def off(size: float, *shape: int) -> Array:
        return scatter * size * rng.standard_normal(shape)

    d = drawing()
    mean, apart = off(0.2e-3, 3), off(0.05e-3, 3)
    return Build(
        hinge=d.hinge + off(0.25e-3, 3, 3),
        tilt=off(0.5e-3, 3, 3) * no_y,
        zero=off(0.8e-3, 3),
        arm=d.arm + off(0.15e-3, 3),
        rod=d.rod + mean[:, None] + SIDES * apart[:, None] / 2,
        elbow=d.elbow + off(0.03e-3, 3, 2),
        elbow_line=off(0.5e-3, 3, 3) * no_y,
        platform=d.platform + off(0.25e-3, 3, 3),
        ball=d.ball + off(0.03e-3, 3, 2),
        platform_line=off(0.5e-3, 3, 3) * no_y,
    )


@dataclass(frozen=True)
class Changed:
    """What differs from the build in each sample: arms, rods, hinges, all (n, ...) [m]."""

    arm: Array  # (n, 3) longer by
    rod: Array  # (n, 3, 2) longer by
    outward: Array  # (n, 3) hinge farther out by

    @classmethod
    def nothing(cls, n: int) -> Changed:
        """The machine as built."""
        return cls(np.zeros((n, 3)), np.zeros((n, 3, 2)), np.zeros((n, 3)))

    def and_rod(self, more: Array) -> Changed:
        """The same with rods longer by more."""
        return replace(self, rod=self.rod + more)


@dataclass(frozen=True)
class Stand:
    """Where the platform is: place (n, 3) [m], orientation (n, 3, 3), and all ball joints."""

    place: Array
    turn: Array
    elbows: Array  # (n, 3, 2, 3)
    balls: Array  # (n, 3, 2, 3)


def elbows(q: Array, build: Build, changed: Changed) -> Array:
    """Ball joints at the elbows, (n, 3, 2, 3) [m]."""
    angle = q + build.zero
    along = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=-1)
    line = Rotation.from_rotvec(build.elbow_line).apply([0.0, 1.0, 0.0])  # (3, 3)
    side = (SIDES * build.elbow)[:, :, None] * line[:, None]  # (3, 2, 3)
    reach = (build.arm + changed.arm)[..., None] * along
    local = reach[:, :, None] + side
    tilt = Rotation.from_rotvec(build.tilt).as_matrix()
    local = np.einsum("lij,nlsj->nlsi", tilt, local) + build.hinge[:, None]
    local[..., 0] += changed.outward[:, :, None]
    return np.einsum("lij,nlsj->nlsi", LEGS, local)


def platform_balls(build: Build) -> Array:
    """Ball joints of the platform in its own directions, (3, 2, 3) [m]."""
    line = Rotation.from_rotvec(build.platform_line).apply([0.0, 1.0, 0.0])
    local = build.platform[:, None] + (SIDES * build.ball)[:, :, None] * line[:, None]
    return np.einsum("lij,lsj->lsi", LEGS, local)


def assemble(q: Array, build: Build, changed: Changed | None = None) -> Stand:
    """Put the platform where all six rods fit, (n, 3) [rad] -> a stand for each."""
    n = len(q)
    changed = changed or Changed.nothing(n)
    e, b = elbows(q, build, changed), platform_balls(build)
    length = (build.rod + changed.rod).reshape(n, 6)
    place = np.tile([0.0, 0.0, -0.75], (n, 1))
    place[:, 2] = e[..., 2].mean(axis=(1, 2)) - 0.7
    turn = np.tile(np.eye(3), (n, 1, 1))
    for _ in range(30):
        arms = np.einsum("nij,lsj->nlsi", turn, b).reshape(n, 6, 3)
        gap = place[:, None] + arms - e.reshape(n, 6, 3)
        distance = np.linalg.norm(gap, axis=2)
        unit = gap / distance[..., None]
        slope = np.concatenate([unit, np.cross(arms, unit)], axis=2)
        step = np.linalg.solve(slope, (length - distance)[..., None])[..., 0]
        place = place + step[:, :3]
        turn = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ turn
        if np.abs(step).max() < 1e-13:
            break
    balls = place[:, None, None] + np.einsum("nij,lsj->nlsi", turn, b)
    return Stand(place, turn, e, balls)


def energy(
    q: Array, build: Build, changed: Changed, payload: Array, centre: Array
) -> Array:
    """Potential energy of everything that moves, (n,) [J]; `centre` (3,) of the payload."""
    stand = assemble(q, build, changed)
    tool = stand.place[:, 2] + (stand.turn @ centre)[:, 2]
    angle = q + build.zero
    arms = -np.sin(angle) * (build.arm + changed.arm) * ARM_CENTRE
    rods = (stand.elbows[..., 2] + stand.balls[..., 2]) / 2
    return GRAVITY * (
        PLATFORM_KG * stand.place[:, 2]
        + payload * tool
        + ARM_KG * arms.sum(axis=1)
        + ROD_KG * rods.sum(axis=(1, 2))
    )


def torques(q: Array, build: Build, changed: Changed, payload: Array, centre: Array) -> Array:
    """dE/dq by differences of the energy, (n, 3) [N m]."""
    h = 1e-5
    each = []
    for joint in range(3):
        d = h * (np.arange(3) == joint)
        up, down = (energy(q + s * d, build, changed, payload, centre) for s in (1, -1))
        each.append((up - down) / (2 * h))
    return np.stack(each, axis=1)


def pulls(q: Array, build: Build, changed: Changed, payload: Array, centre: Array) -> Array:
    """Tension of each rod, -dE/dl by differences of the energy, (n, 3, 2) [N]."""
    h = 1e-6
    tension = np.zeros((len(q), 3, 2))
    for leg in range(3):
        for side in range(2):
            d = np.zeros((3, 2))
            d[leg, side] = h
            up, down = (
                energy(q, build, changed.and_rod(s * d), payload, centre) for s in (1, -1)
            )
            tension[:, leg, side] = -(up - down) / (2 * h)
    return tension
