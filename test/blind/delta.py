"""The six-rod Delta of the generator: masses, tensions, workspace."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blind.kind import Kind
from blind.machine import (
    ARM,
    LEGS,
    PLATFORM,
    RADIUS,
    ROD,
    Build,
    Changed,
    Stand,
    assemble,
    drawing,
    manufactured,
)
from blind.weight import energy

Array = NDArray[np.float64]

PLATFORM_KG, ARM_KG, ROD_KG = 1.2, 1.6, 0.18
ARM_CENTRE = 0.45  # of the arm's length, from the motor axis
_LONGER = 1e-5  # [m] step of finite differences
_LOWEST = np.radians(-30.0)  # [rad] with the approach still above the joint limit


class Delta(Kind):
    """The robot SRBD."""

    robot = "srbd"
    joints = ("joint_1", "joint_2", "joint_3")
    rest = 12e-6
    encoder = 3e-6
    rise: ClassVar = {"arm": (11, 15), "base": (3.5, 6), "forearm": (6, 9)}
    constant: ClassVar = {"arm": (2000, 2800), "base": (3000, 4500), "forearm": (1200, 1800)}
    sensors = ("arm", "base")
    noise = (5e-6, 8e-6)
    expected: ClassVar = {
        "hinge": 0.25e-3,
        "tilt": 0.5e-3,
        "zero": 0.8e-3,
        "arm": 0.15e-3,
        "rod": 0.2e-3,
        "elbow": 0.03e-3,
        "elbow_line": 0.5e-3,
        "platform": 0.25e-3,
        "ball": 0.03e-3,
        "platform_line": 0.5e-3,
    }
    home = np.full(3, 0.116)
    beside = np.full(3, 0.05)
    sweep = 0.3 * np.eye(3)

    def drawing(self) -> Build:
        return drawing()

    def manufactured(self, rng: np.random.Generator, scatter: float) -> Build:
        return manufactured(rng, scatter)

    def nothing(self) -> Changed:
        return Changed.nothing()

    def assemble(
        self, q: Array, build: Build, changed: Changed | None = None, near: Stand | None = None
    ) -> Stand:
        return assemble(q, build, changed, near)

    def masses(
        self, stand: Stand, build: Build, payload: Array, centre: Array
    ) -> tuple[Array, Array]:
        """Masses (n, 17) [kg] and their positions (n, 17, 3) [m].

        A rod is three points with 1/6, 2/3, 1/6 of its mass at ends and middle. Its weight,
        moments and kinetic energy are then those of a uniform rod.
        """
        n = len(stand.place)
        foot, _ = build.hinges
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

    def pulls(
        self,
        q: Array,
        build: Build,
        changed: Changed,
        payload: Array,
        centre: Array,
        near: Stand,
    ) -> Array:
        """Tension of each rod, -dE/dl with the joints held, (n, 3, 2) [N]."""
        result = np.zeros((len(q), 6))
        for rod in range(6):
            longer = _LONGER * np.eye(6)[rod].reshape(1, 3, 2)
            up, down = (
                energy(
                    self,
                    assemble(q, build, changed.and_rod(s * longer), near),
                    build,
                    payload,
                    centre,
                )
                for s in (1, -1)
            )
            result[:, rod] = -(up - down) / (2 * _LONGER)
        return result.reshape(-1, 3, 2)

    def pulls_of_motion(self, moved: Any) -> Array:
        """Tension of each rod that accelerates the masses, (n, 3, 2) [N]."""
        each = []
        for rod in np.eye(6).reshape(6, 1, 3, 2):
            longer = (self.nothing().and_rod(s * _LONGER * rod) for s in (1, -1))
            ends = (moved.where(moved.q, changed) for changed in longer)
            each.append(-moved.work(*ends) / (2 * _LONGER))
        return np.stack(each, axis=1).reshape(-1, 3, 2)

    def reflector(self, rng: np.random.Generator) -> Array:
        return rng.uniform([-0.03, -0.03, -0.06], [0.03, 0.03, -0.02])

    def places(self, rng: np.random.Generator, count: int) -> Array:
        drawn = 4 * count
        bearing = rng.uniform(0, 2 * np.pi, drawn)
        reach, height = 0.4 * np.sqrt(rng.random(drawn)), rng.uniform(-0.86, -0.62, drawn)
        q = self.at(np.stack([reach * np.cos(bearing), reach * np.sin(bearing), height], axis=1))
        return q[q.min(axis=1) > _LOWEST][:count]

    def at(self, points: Array) -> Array:
        """Joint commands for points, by the nominal machine, arms outward."""
        joints = []
        for leg in LEGS:
            outward, aside, up = (points @ leg).T
            outward = outward + PLATFORM - RADIUS
            far2 = outward**2 + aside**2 + up**2
            bend = (far2 + ARM**2 - ROD**2) / (2 * ARM * np.hypot(outward, up))
            joints.append(np.arctan2(-up, outward) - np.arccos(bend))
        return np.stack(joints, axis=1)

    def ring(self, angle: Array, radius: float, level: float) -> Array:
        flat = [radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, level)]
        return np.stack(flat, axis=1)


DELTA = Delta()
