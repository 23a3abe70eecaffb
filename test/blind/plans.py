"""What a blind session commands: stops from both sides under two payloads, sweeps, circles.

Every motion is a smooth function of time, so that speed and acceleration are known at each sample.
A stop is a move to a point a little beside the pose, a slow approach from there, and a dwell; the
tracker reads at 20 Hz. Poor plans leave out what parts one cause from another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from blind.machine import ARM, LEGS, PLATFORM, RADIUS, ROD

Array = NDArray[np.float64]
Path = Callable[[Array], Array]  # times (n,) [s] -> joints (n, 3) [rad]

RATE = 20.0  # [1/s] readings
_HOURS = 2.0
_HEAVY = 2.0  # [kg]
_BESIDE = 0.05  # [rad] where the slow approach begins
_LOWEST = np.radians(-30.0)  # [rad] with the approach still above the joints' limit
_MOVE, _APPROACH, _LEAD = 0.5, 0.4, 1.0  # [s]; to the start of a motion
_DWELL = 20  # readings
_HOME = np.full(3, 0.116)
_SWEEP, _SWEEP_TIME = 0.3, 40.0  # [rad] to either side, [s] one way
_CIRCLE, _LEVEL = 0.14, -0.70  # [m]
_SPEEDS = (0.06, 0.18, 0.5)  # [m/s]
_DELTA = 1e-3  # [s] step of the differences by time


@dataclass(frozen=True)
class Item:
    """One thing to do: a stop with its way there, or a measured motion."""

    begin: float  # [s] of the session
    time: Array  # (n,) [s] from its start
    command: Array  # (n, 3) [rad]
    velocity: Array  # (n, 3) [rad/s]
    acceleration: Array  # (n, 3) [rad/s^2]
    still: NDArray[np.bool_]  # (n,) arrived
    seen: NDArray[np.bool_]  # (n,) whether the tracker reads
    payload: float  # [kg]
    side: float  # +1, -1: from where a stop is approached; 0 for a motion


@dataclass(frozen=True)
class Visit:
    """A pose, the side it is approached from, and what is carried."""

    goal: Array  # (3,) [rad]
    side: float
    payload: float  # [kg]


def rich(rng: np.random.Generator) -> list[Item]:
    """Two hours: 40 places from both sides under two payloads, 30 repeats, sweeps, circles."""
    return _items(_visits(rng, sides=(1.0, -1.0), payloads=(0.0, _HEAVY)), sweeps(), circles())


def no_sweeps(rng: np.random.Generator) -> list[Item]:
    """Rich, without the slow sweeps."""
    return _items(_visits(rng, (1.0, -1.0), (0.0, _HEAVY)), [], circles())


def still(rng: np.random.Generator) -> list[Item]:
    """Rich, without any measured motion."""
    return _only_still(_items(_visits(rng, (1.0, -1.0), (0.0, _HEAVY)), [], []))


def one_payload(rng: np.random.Generator) -> list[Item]:
    """Rich, but nothing is ever carried."""
    return _items(_visits(rng, (1.0, -1.0), (0.0, 0.0)), sweeps(), circles())


def one_sided(rng: np.random.Generator) -> list[Item]:
    """Rich, but every pose is approached from the same side, and nothing measured in motion."""
    return _only_still(_items(_visits(rng, (1.0, 1.0), (0.0, _HEAVY)), [], []))


def poor(rng: np.random.Generator) -> list[Item]:
    """Sixty poses in half an hour: one side, one payload, nothing measured in motion."""
    visits = [Visit(goal, 1.0, 0.0) for goal in places(rng, 60)]
    return _only_still(_items(visits, [], [], hours=0.5))


PLANS: dict[str, Callable[[np.random.Generator], list[Item]]] = {
    "rich": rich,
    "no_sweeps": no_sweeps,
    "still": still,
    "one_payload": one_payload,
    "one_sided": one_sided,
    "poor": poor,
    "no_temperatures": rich,
}


def held_out(rng: np.random.Generator, hours: float, payloads: Sequence[float]) -> list[Item]:
    """Other places, sides, payloads and speeds in the same hours, to judge predictions by."""
    visits = [
        Visit(goal, float(rng.choice([-1.0, 1.0])), float(rng.choice(payloads)))
        for goal in places(rng, 60)
    ]
    motions = [_round(0.11, -0.74, speed, way) for speed, way in ((0.1, 1), (0.35, -1))]
    return _items(visits, [], motions, hours)


def places(rng: np.random.Generator, count: int) -> Array:
    """Joint angles of places all over the workspace, (count, 3) [rad]."""
    drawn = 4 * count
    bearing = rng.uniform(0, 2 * np.pi, drawn)
    reach, height = 0.4 * np.sqrt(rng.random(drawn)), rng.uniform(-0.86, -0.62, drawn)
    q = joints_at(np.stack([reach * np.cos(bearing), reach * np.sin(bearing), height], axis=1))
    return q[q.min(axis=1) > _LOWEST][:count]


def joints_at(points: Array) -> Array:
    """What the controller commands for points: the machine as drawn, arms outward, (n, 3)."""
    joints = []
    for leg in LEGS:
        outward, aside, up = (points @ leg).T
        outward = outward + PLATFORM - RADIUS
        far2 = outward**2 + aside**2 + up**2
        bend = (far2 + ARM**2 - ROD**2) / (2 * ARM * np.hypot(outward, up))
        joints.append(np.arctan2(-up, outward) - np.arccos(bend))
    return np.stack(joints, axis=1)


def _visits(
    rng: np.random.Generator, sides: tuple[float, float], payloads: tuple[float, float]
) -> list[Visit]:
    """Four blocks of time, payloads in turn; places, sides and repeats shuffled within each."""
    goals = places(rng, 40)
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
    visits: list[Visit],
    slow: list[tuple[Path, float]],
    fast: list[tuple[Path, float]],
    hours: float = _HOURS,
) -> list[Item]:
    every, here, items = hours * 3600 / (len(visits) + 0.25), _HOME, []
    for number, visit in enumerate(visits):
        items.append(_stop(here, visit, number * every))
        here = visit.goal
    begin = len(visits) * every
    for path, duration in slow + fast:
        way = _line(here, path(np.zeros(1))[0], _LEAD)
        whole = _joined([(way, _LEAD), (path, duration)])
        items.append(_item(begin, whole, _LEAD + duration, 0.0, 0.0, np.inf))
        begin += items[-1].time[-1] + 1 / RATE
        here = items[-1].command[-1]
    return items


def _only_still(items: list[Item]) -> list[Item]:
    return [replace(item, seen=item.still) for item in items]


def _stop(here: Array, visit: Visit, begin: float) -> Item:
    beside = visit.goal - visit.side * _BESIDE
    there, rest = _line(here, beside, _MOVE), _line(beside, visit.goal, _APPROACH)
    way, arrived = _joined([(there, _MOVE), (rest, _APPROACH)]), _MOVE + _APPROACH
    return _item(begin, way, arrived + _DWELL / RATE, visit.payload, visit.side, arrived)


def _item(
    begin: float, path: Path, duration: float, payload: float, side: float, arrived: float
) -> Item:
    time = np.arange(round(duration * RATE)) / RATE
    before, command, after = (path(time + s * _DELTA) for s in (-1, 0, 1))
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


def _line(start: Array, goal: Array, duration: float) -> Path:
    """From rest to rest with the least jerk."""

    def path(time: Array) -> Array:
        return start + _smooth(time / duration)[:, None] * (goal - start)

    return path


def _smooth(u: Array) -> Array:
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def _joined(parts: list[tuple[Path, float]]) -> Path:
    """One path after the other; each waits at its ends."""

    def path(time: Array) -> Array:
        result, begin = parts[0][0](time), 0.0
        for (_, before), (following, _) in pairwise(parts):
            begin += before
            result = np.where((time >= begin)[:, None], following(time - begin), result)
        return result

    return path


def sweeps() -> list[tuple[Path, float]]:
    """Each joint in turn, slowly there and back, the others standing."""
    motions = []
    for joint in np.eye(3):
        low, high = _HOME - _SWEEP * joint, _HOME + _SWEEP * joint
        there, back = _line(low, high, _SWEEP_TIME), _line(high, low, _SWEEP_TIME)
        motions.append((_joined([(there, _SWEEP_TIME), (back, _SWEEP_TIME)]), 2 * _SWEEP_TIME))
    return motions


def circles() -> list[tuple[Path, float]]:
    """A circle at three speeds, both ways round."""
    return [_round(_CIRCLE, _LEVEL, speed, way) for speed in _SPEEDS for way in (1, -1)]


def _round(radius: float, level: float, speed: float, way: int) -> tuple[Path, float]:
    """Round twice, or once where it takes long, after and before a second of speeding up."""
    turns = 1 if speed < 0.1 else 2
    steady = 2 * np.pi * turns * radius / speed
    duration = steady + 1.0

    def path(time: Array) -> Array:
        time = np.clip(time, 0.0, duration)
        gained = _gained(time) - _gained(time - steady)
        angle = way * gained * speed / radius
        ring = [radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, level)]
        return joints_at(np.stack(ring, axis=1))

    return path, duration


def _gained(time: Array) -> Array:
    """Integral of the smooth rise to speed 1 within a second, [s]."""
    u = np.clip(time, 0.0, 1.0)
    return u**4 * (2.5 - 3 * u + u**2) + np.clip(time - 1.0, 0.0, None)
