"""Commands of a session: stops from both sides under two payloads, and circles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.bodies import STEP
from physics.machine import ARM, PLATFORM, RADIUS, ROD

Array = NDArray[np.float64]

EVERY = 100  # steps between readings
_BESIDE = 0.02  # [rad] distance at which the slow approach begins
_MOVE, _APPROACH, _SETTLE = 0.4, 0.35, 0.25  # [s]
_START, _LEVEL, _RADIUS = 0.3, -0.70, 0.14  # [s] to full speed, [m], [m]
_LOWEST, _HIGHEST = np.radians(-30), np.radians(95)
_LOW, _HIGH = -0.86, -0.60  # [m] of the workspace
HEAVY = 2.0  # [kg]


@dataclass(frozen=True)
class Item:
    """One part of a plan.

    Attributes:
        command: of the motors at every step, (n, 3) [rad].
        payload: [kg].
        dwell: number of readings at the end, at the place where it has settled; 0 for a motion,
            which is measured all the way.
    """

    command: Array
    payload: float
    dwell: int


def joints_at(point: Array) -> Array:
    """Nominal motor angles for points (n, 3) [m], arms outward, (n, 3) [rad]."""
    angles = []
    for leg in range(3):
        turn = 2 * np.pi / 3 * leg
        out = point[:, 0] * np.cos(turn) + point[:, 1] * np.sin(turn) + PLATFORM - RADIUS
        aside = point[:, 1] * np.cos(turn) - point[:, 0] * np.sin(turn)
        down = -point[:, 2]
        # |elbow - ball|^2 = ROD^2 with the elbow at ARM (cos q, 0, -sin q)
        whole = (out**2 + aside**2 + down**2 + ARM**2 - ROD**2) / (2 * ARM)
        angles.append(np.arctan2(down, out) - np.arccos(whole / np.hypot(out, down)))
    return np.stack(angles, axis=1)


def places(rng: np.random.Generator, count: int, reach: float = 0.4) -> Array:
    """Motor angles distributed over the workspace, (count, 3) [rad]."""
    drawn = 6 * count
    bearing, far = rng.uniform(0, 2 * np.pi, drawn), reach * np.sqrt(rng.random(drawn))
    height = rng.uniform(_LOW, _HIGH, drawn)
    q = joints_at(np.stack([far * np.cos(bearing), far * np.sin(bearing), height], axis=1))
    return q[(q.min(axis=1) > _LOWEST) & (q.max(axis=1) < _HIGHEST)][:count]


def stops(
    rng: np.random.Generator,
    count: int,
    payloads: tuple[float, ...] = (0.0, HEAVY),
    repeats: int = 8,
    reach: float = 0.4,
) -> list[Item]:
    """Places from both sides under each payload, shuffled, some of them three times.

    Args:
        rng: of places and order.
        count: of places.
        payloads: one after the other [kg].
        repeats: number of stops that are repeated twice.
        reach: of the places from the middle [m].
    """
    goals = places(rng, count, reach)
    items, here = [], np.zeros(3)
    for payload in payloads:
        every = [(goal, side) for goal in goals for side in (1.0, -1.0)]
        again = [every[k] for k in rng.choice(len(every), repeats, replace=False)] * 2
        todo = every + (again if payload == payloads[0] else [])
        for k in rng.permutation(len(todo)):
            goal, side = todo[k]
            beside = goal - side * _BESIDE
            way = (_way(here, beside, _MOVE), _way(beside, goal, _APPROACH))
            still = np.tile(goal, (round(_SETTLE / STEP), 1))
            items.append(Item(np.concatenate([*way, still]), payload, 12))
            here = goal
    return items


def circles(
    here: Array, payload: float, speeds: tuple[float, ...] = (0.06, 0.18, 0.5)
) -> list[Item]:
    """Circles in both directions at some speeds [m/s], from the current motor angles."""
    items = []
    for speed in speeds:
        for way in (1.0, -1.0):
            course = joints_at(_round(speed, way))
            command = np.concatenate([_way(here, course[0], 2 * _MOVE), course])
            items.append(Item(command, payload, 0))
            here = course[-1]
    return items


def _way(start: Array, end: Array, seconds: float) -> Array:
    """Path from rest to rest, with continuous acceleration, (n, 3)."""
    t = (np.arange(round(seconds / STEP)) + 1)[:, None] * STEP / seconds
    return start + (end - start) * t**3 * (10 - 15 * t + 6 * t**2)


def _round(speed: float, way: float) -> Array:
    """Points of one circle, from rest to rest, (n, 3) [m]."""
    whole = 2 * np.pi * _RADIUS / speed + _START
    t = np.arange(round(whole / STEP)) * STEP

    def gone(time: Array) -> Array:
        """Travel at full speed, started smoothly within `_START`."""
        u = np.clip(time / _START, 0, 1)
        rising = _START * (u**6 - 3 * u**5 + 2.5 * u**4)  # derivative rises smoothly from 0 to 1
        return np.where(time < _START, rising, time - _START / 2)

    way_gone = np.where(t < whole / 2, gone(t), whole - _START - gone(whole - t))
    angle = way * speed * way_gone / _RADIUS
    level = np.full_like(angle, _LEVEL)
    return np.stack([_RADIUS * np.cos(angle), _RADIUS * np.sin(angle), level], axis=1)
