"""A rotary Delta of six separate rods, solved for many samples at once.

Ball joints are points, a rod is a distance between two of them, and the platform lies where all
six distances are right. Its orientation is a Gibbs vector g (tangent of half the angle), so that R
b = b + 2 (g x b + g x (g x b)) / (1 + g.g) is exact and has no singularity near upright. What may
change from sample to sample (a rod that stretches, an arm that grows) is an argument of the
solution, not of the machine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

RADIUS, PLATFORM, ARM, ROD, HALF = 0.2, 0.055, 0.32, 0.85, 0.04  # [m] SRBD
SIDES = np.array([-1.0, 1.0])
LEGS: Array = Rotation.from_rotvec(
    np.array([[0.0, 0.0, 2 * np.pi / 3 * leg] for leg in range(3)])
).as_matrix()
_CLOSED = 1e-13  # [m] and half radians
_MOST = 25


@dataclass(frozen=True)
class Build:
    """Dimensions of a machine as built; lengths [m], angles [rad]; one row per leg."""

    hinge: Array  # (3, 3) of the motor's axis, in the leg's directions: outward, along, up
    tilt: Array  # (3, 3) rotation vector of the hinge
    zero: Array  # (3,)
    arm: Array  # (3,)
    rod: Array  # (3, 2)
    elbow: Array  # (3, 2) ball joint from the middle of its pair
    elbow_line: Array  # (3, 3) rotation vector of the pair's line, in the arm's directions
    platform: Array  # (3, 3) middle of the platform's pair, in the leg's directions
    ball: Array  # (3, 2)
    platform_line: Array  # (3, 3)

    @cached_property
    def hinges(self) -> tuple[Array, Array]:
        """Places of the hinges (3, 3), and directions x, y, z of each in columns (3, 3, 3)."""
        turned = LEGS @ Rotation.from_rotvec(self.tilt).as_matrix()
        return np.einsum("lij,lj->li", LEGS, self.hinge), turned

    @cached_property
    def ends(self) -> Array:
        """Ball joints from the ends of the arms, in the directions of the arms, (3, 2, 3) [m]."""
        line = Rotation.from_rotvec(self.elbow_line).apply([0.0, 1.0, 0.0])
        return (SIDES * self.elbow)[:, :, None] * line[:, None]

    @cached_property
    def balls(self) -> Array:
        """Ball joints of the platform in its own directions, (3, 2, 3) [m]."""
        line = Rotation.from_rotvec(self.platform_line).apply([0.0, 1.0, 0.0])
        local = self.platform[:, None] + (SIDES * self.ball)[:, :, None] * line[:, None]
        return np.einsum("lij,lsj->lsi", LEGS, local)


def drawing() -> Build:
    """The nominal machine."""
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
    """A machine as built: every part deviates by `scatter` times a good workshop's tolerance."""
    # Rotated about its own line a pair remains the same pair.
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
    """Differences from the build in each sample [m]; first axis n, or 1 if all are alike."""

    arm: Array  # (n, 3) longer by
    rod: Array  # (n, 3, 2) longer by
    outward: Array  # (n, 3) hinge farther out by

    @classmethod
    def nothing(cls, n: int = 1) -> Changed:
        """The machine as built."""
        return cls(np.zeros((n, 3)), np.zeros((n, 3, 2)), np.zeros((n, 3)))

    def and_arm(self, more: Array) -> Changed:
        """The same with arms longer by `more`, (n, 3)."""
        return replace(self, arm=self.arm + more)

    def and_rod(self, more: Array) -> Changed:
        """The same with rods longer by `more`, (n, 3, 2)."""
        return replace(self, rod=self.rod + more)

    def and_outward(self, more: Array) -> Changed:
        """The same with hinges farther out by `more`, (n, 3)."""
        return replace(self, outward=self.outward + more)

    def take(self, rows: NDArray[np.int64]) -> Changed:
        """A subset of the samples."""

        def some(values: Array) -> Array:
            return values if len(values) == 1 else values[rows]

        return Changed(some(self.arm), some(self.rod), some(self.outward))


@dataclass(frozen=True)
class Stand:
    """Pose of the platform, and the points that move with it."""

    place: Array  # (n, 3) [m]
    gibbs: Array  # (n, 3)
    inverse: Array  # (n, 6, 6) of the closure's derivative, for solutions near here
    elbows: Array  # (n, 3, 2, 3) [m]
    arms: Array  # (n, 3, 3) middle of the elbow of each arm [m]
    balls: Array  # (3, 2, 3) of the platform in its own directions

    def point(self, local: Array) -> Array:
        """A point fixed to the platform, (3,) -> (n, 3) [m]."""
        return self.place + turned(self.gibbs, local[None])[:, 0]

    def ends(self) -> Array:
        """Ball joints of the platform, (n, 3, 2, 3) [m]."""
        flat = self.balls.reshape(6, 3)
        return (self.place[:, None] + turned(self.gibbs, flat)).reshape(-1, 3, 2, 3)

    def take(self, rows: NDArray[np.int64]) -> Stand:
        """A subset of the samples."""
        return Stand(
            self.place[rows],
            self.gibbs[rows],
            self.inverse[rows],
            self.elbows[rows],
            self.arms[rows],
            self.balls,
        )


def turned(gibbs: Array, local: Array) -> Array:
    """Points (k, 3) rotated by each of n Gibbs vectors, (n, k, 3)."""
    x, y, z = gibbs.T
    nothing = np.zeros_like(x)
    cross = np.stack([nothing, -z, y, z, nothing, -x, -y, x, nothing], axis=1).reshape(-1, 3, 3)
    share = 2 / (1 + np.sum(gibbs**2, axis=1))
    turn = np.eye(3) + share[:, None, None] * (cross + cross @ cross)
    return local @ turn.transpose(0, 2, 1)


def gaps(place: Array, gibbs: Array, elbows: Array, balls: Array, length: Array) -> Array:
    """Closure: the length by which each rod is too short, (n, 6) [m]."""
    rods = place[:, None] + turned(gibbs, balls) - elbows
    return (np.einsum("nki,nki->nk", rods, rods) - length**2) / (2 * length)


def assemble(
    q: Array, build: Build, changed: Changed | None = None, near: Stand | None = None
) -> Stand:
    """Close the mechanism at joint angles q, (n, 3) [rad].

    The derivative of the closure is inverted once, at the start. From a start a millimetre away
    every step gains three digits, so that effects of tens of micrometres take three cheap steps.
    """
    changed = Changed.nothing() if changed is None else changed
    arms, elbows = _elbows(q, build, changed)
    flat, balls = elbows.reshape(len(q), 6, 3), build.balls.reshape(6, 3)
    length = (build.rod + changed.rod).reshape(-1, 6)
    if near is None:
        place, gibbs = _start(arms, build, length), np.zeros((len(q), 3))
        inverse = _inverse(place, gibbs, flat, balls)
    else:
        place, gibbs, inverse = near.place, near.gibbs, near.inverse
    for _ in range(_MOST):
        wrong = gaps(place, gibbs, flat, balls, length)
        step = -(inverse @ wrong[..., None])[..., 0]
        place, gibbs = place + step[:, :3], gibbs + step[:, 3:]
        if np.abs(step).max() < _CLOSED:
            return Stand(place, gibbs, inverse, elbows, arms, build.balls)
    raise ArithmeticError(f"the mechanism does not close: last step {np.abs(step).max():.1e}")


def _elbows(q: Array, build: Build, changed: Changed) -> tuple[Array, Array]:
    """Middle of each elbow (n, 3, 3), and its ball joints (n, 3, 2, 3) [m]."""
    foot, turned = build.hinges
    cosine, sine = np.cos(q + build.zero), np.sin(q + build.zero)
    along, across, normal = np.moveaxis(turned, 2, 0)
    ahead = cosine[..., None] * along - sine[..., None] * normal
    above = sine[..., None] * along + cosine[..., None] * normal
    x, y, z = np.moveaxis(build.ends, 2, 0)[..., None]
    arm = foot + changed.outward[..., None] * LEGS[:, :, 0]
    arm = arm + (build.arm + changed.arm)[..., None] * ahead
    aside = x * ahead[:, :, None] + y * across[:, None] + z * above[:, :, None]
    balls = arm[:, :, None] + aside
    return balls.mean(axis=2), balls


def _start(arms: Array, build: Build, length: Array) -> Array:
    """Start: upright platform, lower intersection of three spheres by the mean rods, (n, 3)."""
    one, two, three = np.moveaxis(arms - build.balls.mean(axis=1), 1, 0)
    r = length.reshape(-1, 3, 2).mean(axis=2)
    a, b = two - one, three - one
    x = a / np.linalg.norm(a, axis=1, keepdims=True)
    along = np.sum(b * x, axis=1, keepdims=True)
    y = b - along * x
    across = np.linalg.norm(y, axis=1, keepdims=True)
    y = y / across
    d = np.linalg.norm(a, axis=1)
    r1, r2, r3 = (r[:, k] for k in range(3))
    u = (r1**2 - r2**2 + d**2) / (2 * d)
    i, j = along[:, 0], across[:, 0]
    v = (r1**2 - r3**2 + i**2 + j**2 - 2 * i * u) / (2 * j)
    w = np.sqrt(r1**2 - u**2 - v**2)
    down = -np.cross(x, y)
    return one + u[:, None] * x + v[:, None] * y + w[:, None] * down


def _inverse(place: Array, gibbs: Array, elbows: Array, balls: Array) -> Array:
    """Inverse derivative of the closure by position and Gibbs vector, (n, 6, 6)."""
    arms = turned(gibbs, balls)
    rods = place[:, None] + arms - elbows
    unit = rods / np.linalg.norm(rods, axis=2, keepdims=True)
    return np.linalg.inv(np.concatenate([unit, 2 * np.cross(arms, unit)], axis=2))
