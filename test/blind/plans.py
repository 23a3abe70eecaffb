"""Commands of a blind session: stops from both sides under two payloads, sweeps, circles.

Every motion is a smooth function of time, so speed and acceleration are known at each sample. A
stop is a move to a point a little beside the pose, a slow approach from there, and a dwell; the
tracker measures at 20 Hz. Poor plans leave out what distinguishes causes from one another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from blind.kind import Kind, Way

Array = NDArray[np.float64]

RATE = 20.0  # [1/s] readings
_HOURS = 2.0
_MOVE, _APPROACH, _LEAD = 0.5, 0.4, 1.0  # [s]; the last until the start of a motion
_DWELL = 20  # readings
_SWEEP_TIME = 40.0  # [s] one way
_SPEEDS = (0.06, 0.18, 0.5)  # [m/s]
BOTH = (1.0, -1.0)  # sides
_DELTA = 1e-3  # [s] step of the time differences


@dataclass(frozen=True)
class Item:
    """One part of a plan: a stop with the move to it, or a measured motion."""

    begin: float  # [s] of the session
    time: Array  # (n,) [s] from its start
    command: Array  # (n, m) [rad]
    velocity: Array  # (n, m) [rad/s]
    acceleration: Array  # (n, m) [rad/s^2]
    still: NDArray[np.bool_]  # (n,) whether it has arrived
    seen: NDArray[np.bool_]  # (n,) whether the tracker measures
    payload: float  # [kg]
    side: float  # +1, -1: side of approach to a stop; 0 for a motion


@dataclass(frozen=True)
class Visit:
    """A pose, its side of approach, and the payload."""

    goal: Array  # (k,) of u
    side: float
    payload: float  # [kg]


def rich(rng: np.random.Generator, kind: Kind) -> list[Item]:
    """Two hours: 40 places from both sides under two payloads, 30 repeats, sweeps, circles."""
    return _items(kind, _visits(kind, rng, BOTH, (0.0, kind.heavy)), sweeps(kind), circles(kind))


def no_sweeps(rng: np.random.Generator, kind: Kind) -> list[Item]:
    """Rich, without the slow sweeps."""
    return _items(kind, _visits(kind, rng, BOTH, (0.0, kind.heavy)), [], circles(kind))


def still(rng: np.random.Generator, kind: Kind) -> list[Item]:
    """Rich, without any measured motion."""
    return _only_still(_items(kind, _visits(kind, rng, BOTH, (0.0, kind.heavy)), [], []))


def one_payload(rng: np.random.Generator, kind: Kind) -> list[Item]:
    """Rich, but without any payload."""
    return _items(kind, _visits(kind, rng, BOTH, (0.0, 0.0)), sweeps(kind), circles(kind))


def one_sided(rng: np.random.Generator, kind: Kind) -> list[Item]:
    """Rich, but with every pose approached from the same side, and nothing measured in motion."""
    return _only_still(_items(kind, _visits(kind, rng, (1.0, 1.0), (0.0, kind.heavy)), [], []))


def poor(rng: np.random.Generator, kind: Kind) -> list[Item]:
    """Sixty poses in half an hour: one side, one payload, nothing measured in motion."""
    visits = [Visit(goal, 1.0, 0.0) for goal in kind.places(rng, 60)]
    return _only_still(_items(kind, visits, [], [], hours=0.5))


PLANS: dict[str, Callable[[np.random.Generator, Kind], list[Item]]] = {
    "rich": rich,
    "no_sweeps": no_sweeps,
    "still": still,
    "one_payload": one_payload,
    "one_sided": one_sided,
    "poor": poor,
    "no_temperatures": rich,
}


def held_out(
    rng: np.random.Generator, kind: Kind, hours: float, payloads: Sequence[float]
) -> list[Item]:
    """Other places, sides, payloads and speeds over the same hours, for testing predictions."""
    visits = [
        Visit(goal, float(rng.choice([-1.0, 1.0])), float(rng.choice(payloads)))
        for goal in kind.places(rng, 60)
    ]
    ways = zip(kind.others, ((0.1, 1), (0.35, -1)), strict=True)
    motions = [_round(kind, *circle, speed, way) for circle, (speed, way) in ways]
    return _items(kind, visits, [], motions, hours)


def _visits(
    kind: Kind,
    rng: np.random.Generator,
    sides: tuple[float, float],
    payloads: tuple[float, float],
) -> list[Visit]:
    """Four blocks of time with alternating payload; places, sides and repeats shuffled in each."""
    goals = kind.places(rng, 40)
    every = [(goal, side) for goal in goals for side in sides]
    visits: list[Visit] = []
    again = [every[k] for k in rng.choice(len(every), 10, replace=False)] * 3
    for payload in payloads:
        todo = every + (again if not visits else [])
        visits += [Visit(*todo[k], payload) for k in rng.permutation(len(todo))]
    light, heavy = visits[: len(every) + len(again)], visits[len(every) + len(again) :]
    a, b = len(light) // 2, len(heavy) // 2
    return light[:a] + heavy[:b] + light[a:] + heavy[b:]


def _items(
    kind: Kind,
    visits: list[Visit],
    slow: list[tuple[Way, float]],
    fast: list[tuple[Way, float]],
    hours: float = _HOURS,
) -> list[Item]:
    every, here, items = hours * 3600 / (len(visits) + 0.25), kind.home, []
    for number, visit in enumerate(visits):
        items.append(_stop(kind, here, visit, number * every))
        here = visit.goal
    begin = len(visits) * every
    for path, duration in slow + fast:
        way = _line(here, path(np.zeros(1))[0], _LEAD)
        whole = _joined([(way, _LEAD), (path, duration)])
        items.append(_item(kind, begin, whole, _LEAD + duration, 0.0, 0.0, np.inf))
        begin += items[-1].time[-1] + 1 / RATE
        here = whole(items[-1].time[-1:])[0]
    return items


def _only_still(items: list[Item]) -> list[Item]:
    return [replace(item, seen=item.still) for item in items]


def _stop(kind: Kind, here: Array, visit: Visit, begin: float) -> Item:
    beside = visit.goal - visit.side * kind.beside
    there, rest = _line(here, beside, _MOVE), _line(beside, visit.goal, _APPROACH)
    way, arrived = _joined([(there, _MOVE), (rest, _APPROACH)]), _MOVE + _APPROACH
    return _item(kind, begin, way, arrived + _DWELL / RATE, visit.payload, visit.side, arrived)


def _item(
    kind: Kind,
    begin: float,
    path: Way,
    duration: float,
    payload: float,
    side: float,
    arrived: float,
) -> Item:
    time = np.arange(round(duration * RATE)) / RATE
    before, command, after = (kind.command(path(time + s * _DELTA)) for s in (-1, 0, 1))
    return Item(
        begin=begin,
        time=time,
        command=command,
        velocity=(after - before) / (2 * _DELTA),
        acceleration=(after - 2 * command + before) / _DELTA**2,
        still=time > arrived - 0.1 / RATE,
        seen=np.ones(len(time), dtype=bool),
        payload=payload,
        side=side,
    )


def _line(start: Array, goal: Array, duration: float) -> Way:
    """Straight path from rest to rest with minimum jerk."""

    def path(time: Array) -> Array:
        return start + _smooth(time / duration)[:, None] * (goal - start)

    return path


def _smooth(u: Array) -> Array:
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def _joined(parts: list[tuple[Way, float]]) -> Way:
    """Paths one after the other; each rests at its ends."""

    def path(time: Array) -> Array:
        result, begin = parts[0][0](time), 0.0
        for (_, before), (following, _) in pairwise(parts):
            begin += before
            result = np.where((time >= begin)[:, None], following(time - begin), result)
        return result

    return path


def sweeps(kind: Kind) -> list[tuple[Way, float]]:
    """Each joint in turn, slowly there and back, while the others stand still."""
    motions = []
    for aside in kind.sweep:
        low, high = kind.home - aside, kind.home + aside
        there, back = _line(low, high, _SWEEP_TIME), _line(high, low, _SWEEP_TIME)
        motions.append((_joined([(there, _SWEEP_TIME), (back, _SWEEP_TIME)]), 2 * _SWEEP_TIME))
    return motions


def circles(kind: Kind) -> list[tuple[Way, float]]:
    """A circle at three speeds in both directions."""
    return [_round(kind, *kind.circle, speed, way) for speed in _SPEEDS for way in (1, -1)]


def _round(kind: Kind, radius: float, level: float, speed: float, way: int) -> tuple[Way, float]:
    """Two rounds, or one at low speed, between a second each of acceleration and deceleration."""
    turns = 1 if speed < 0.1 else 2
    steady = 2 * np.pi * turns * radius / speed
    duration = steady + 1.0

    def path(time: Array) -> Array:
        time = np.clip(time, 0.0, duration)
        gained = _gained(time) - _gained(time - steady)
        angle = way * gained * speed / radius
        return kind.at(kind.ring(angle, radius, level))

    return path, duration


def _gained(time: Array) -> Array:
    """Integral of the smooth rise to speed 1 within one second, [s]."""
    u = np.clip(time, 0.0, 1.0)
    return u**4 * (2.5 - 3 * u + u**2) + np.clip(time - 1.0, 0.0, None)
