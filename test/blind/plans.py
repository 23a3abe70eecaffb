"""What a blind session commands: stops from one side or both, payloads, sweeps, circles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blind.machine import assemble, drawing

Array = NDArray[np.float64]

RATE = 20.0  # [1/s]
_APPROACH = 0.02  # [rad]
_READINGS = 8  # a stop


@dataclass(frozen=True)
class Item:
    """One thing to do: a stop (its way there, then readings) or a measured motion."""

    time: Array  # (n,) [s] from its start
    command: Array  # (n, 3) [rad]
    seen: NDArray[np.bool_]  # (n,) whether the tracker reads
    payload: float  # [kg]
    begin: float  # [s] of the session
    moving: bool


def rich(rng: np.random.Generator, hours: float = 2.0) -> list[Item]:
    """Two hours: 40 places from both sides under two payloads, repeats, sweeps, circles."""
    places = _places(rng, 40)
    visits = [(p, side) for p in range(40) for side in (1.0, -1.0)]
    stops: list[tuple[int, float, float]] = []
    for block in range(4):
        payload = 2.0 * (block % 2)
        chosen = [v for i, v in enumerate(visits) if i % 2 == block // 2]
        again = [visits[i] for i in rng.integers(0, len(visits), 8)]
        order = rng.permutation(len(chosen) + len(again))
        mixed = [(chosen + again)[i] for i in order]
        stops += [(p, side, payload) for p, side in mixed]
    items = _stops(places, stops, hours * 3600)
    return items + _motions(hours * 3600)


def poor(rng: np.random.Generator) -> list[Item]:
    """Sixty poses in half an hour: one side, one payload, nothing in motion."""
    places = _places(rng, 60)
    return _stops(places, [(p, 1.0, 0.0) for p in range(60)], 1800.0)


def one_sided(rng: np.random.Generator) -> list[Item]:
    """Rich, but every pose approached from the same side and nothing in motion."""
    places = _places(rng, 45)
    stops = [(p, 1.0, 2.0 * (i // 45 % 2)) for i, p in enumerate(np.tile(np.arange(45), 4))]
    return _stops(places, [(int(p), s, m) for p, s, m in stops], 7200.0)


def one_payload(rng: np.random.Generator) -> list[Item]:
    """Rich, but with no payload ever."""
    return [Item(i.time, i.command, i.seen, 0.0, i.begin, i.moving) for i in rich(rng)]


def still(rng: np.random.Generator) -> list[Item]:
    """Rich, without anything in motion."""
    return [item for item in rich(rng) if not item.moving]


PLANS = {"rich": rich, "poor": poor, "one_sided": one_sided, "one_payload": one_payload,
         "still": still}  # fmt: skip


def _places(rng: np.random.Generator, count: int) -> Array:
    """Joint angles of places all over the workspace, (count, 3) [rad]."""
    bearing, reach = rng.uniform(0, 2 * np.pi, count), 0.4 * np.sqrt(rng.uniform(0, 1, count))
    height = rng.uniform(-0.86, -0.62, count)
    points = np.stack([reach * np.cos(bearing), reach * np.sin(bearing), height], axis=1)
    return joints_at(points)


def joints_at(points: Array) -> Array:
    """Joints that bring the machine as drawn to points, by search, (n, 3)."""
    build = drawing()
    q = np.full(points.shape, 0.2)
    for _ in range(30):
        h = 1e-6
        here = assemble(q, build).place
        slope = np.stack(
            [(assemble(q + h * e, build).place - here) / h for e in np.eye(3)], axis=-1
        )
        step = np.linalg.solve(slope, (points - here)[..., None])[..., 0]
        q = q + np.clip(step, -0.3, 0.3)
        if np.abs(step).max() < 1e-11:
            break
    return q


def _stops(places: Array, stops: list[tuple[int, float, float]], length: float) -> list[Item]:
    every = length / len(stops)
    items = []
    for number, (place, side, payload) in enumerate(stops):
        goal = places[place]
        way = goal - side * _APPROACH * np.linspace(1.0, 0.0, 6)[:, None]
        command = np.concatenate([way, np.tile(goal, (_READINGS, 1))])
        time = np.concatenate([0.3 * np.arange(6), 2.0 + np.arange(_READINGS) / RATE])
        seen = np.arange(len(time)) >= 6
        items.append(Item(time, command, seen, payload, number * every, False))
    return items


def _motions(begin: float) -> list[Item]:
    """A slow sweep of each joint there and back, circles at three speeds both ways round."""
    items = []
    home = np.full(3, 0.1)
    for joint in range(3):
        turn = np.linspace(0, 2 * np.pi, int(40 * RATE))
        sweep = home - 0.3 * np.cos(turn)[:, None] * (np.arange(3) == joint)
        items.append(sweep)
    for period in (24.0, 8.0, 4.0):
        for way in (1, -1):
            turn = way * np.linspace(0, 2 * np.pi, int(period * RATE))
            points = np.stack(
                [0.2 * np.cos(turn), 0.2 * np.sin(turn), np.full_like(turn, -0.72)], axis=1
            )
            items.append(joints_at(points))
    result = []
    for command in items:
        time = np.arange(len(command)) / RATE
        seen = np.ones(len(time), dtype=bool)
        result.append(Item(time, command, seen, 0.0, begin, True))
        begin += time[-1] + 5.0
    return result
