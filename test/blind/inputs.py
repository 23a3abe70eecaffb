"""Inputs that a law may depend on, by the names of the glossary, and the displacements by it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from blind.world import State, World

Array = NDArray[np.float64]

_ROOM = 20.0  # [deg C]
_EACH = ("q", "rate", "acceleration", "direction", "travel", "torque")
_RODS = tuple(f"{leg}{side}" for leg in (1, 2, 3) for side in "ab")
_PARTS = ("arm", "base", "forearm")


class Inputs(Mapping[str, Array]):
    """Inputs of a world, each (n,) in SI units and degrees Celsius, computed when first used.

    A torque is the drive torque against weight and inertia; the tension of a rod is that of
    weight.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._known: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        if name not in self._known:
            word, _, which = name.partition("_")
            if word in _EACH and which in ("1", "2", "3"):
                values = _OF_JOINTS[word](self._world)
                self._known |= {f"{word}_{leg + 1}": values[:, leg] for leg in range(3)}
            elif word == "force" and which in _RODS:
                pulls = self._world.pulls(self._world.kind.nothing()).reshape(-1, 6)
                self._known |= {f"force_{rod}": pulls[:, k] for k, rod in enumerate(_RODS)}
            elif word == "temperature" and which in _PARTS:
                warm = self._world.warming.of(which, self._world.time)
                self._known[name] = _ROOM + warm
            else:
                self._known[name] = _SHARED[name](self._world)
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        yield from (f"{word}_{leg}" for word in _EACH for leg in (1, 2, 3))
        yield from (f"force_{rod}" for rod in _RODS)
        yield from (f"temperature_{part}" for part in _PARTS)
        yield from _SHARED

    def __len__(self) -> int:
        return sum(1 for _ in self)


def put(state: State, moved: Mapping[str, Array]) -> None:
    """Apply the displacements of a law to the state, by the names of its left sides."""
    for name, by in moved.items():
        word, _, where = name.removeprefix("d").partition("_")
        if word in ("x", "y", "z"):
            axis = np.eye(3)["xyz".index(word)]
            state.shift = state.shift + by[:, None] * axis
            continue
        leg = int(where[0]) - 1
        of_leg = by[:, None] * np.eye(3)[leg]
        if word == "q":
            state.joint[:, leg] += by
        elif word == "arm":
            state.changed = state.changed.and_arm(of_leg)
        elif word == "hinge":
            state.changed = state.changed.and_outward(of_leg)
        else:
            side = np.eye(2)["ab".index(where[1])]
            state.changed = state.changed.and_rod(of_leg[..., None] * side)


def _direction(world: World) -> Array:
    """Last direction of motion of each joint, (n, 3): -1, 1, or 0 before its first motion."""
    way = np.sign(np.diff(world.command, axis=0, prepend=world.command[:1]))
    last = np.maximum.accumulate(np.where(way != 0, np.arange(len(way))[:, None], 0), axis=0)
    return np.take_along_axis(way, last, axis=0)


def _travel(world: World) -> Array:
    """Travel of each joint since its last reversal, (n, 3) [rad]."""
    gone = np.cumsum(np.abs(np.diff(world.command, axis=0, prepend=world.command[:1])), axis=0)
    turned = np.diff(_direction(world), axis=0, prepend=0) != 0
    before = np.concatenate([np.zeros((1, 3)), gone[:-1]])
    return gone - np.maximum.accumulate(np.where(turned, before, 0.0), axis=0)


def _speed(world: World) -> Array:
    """Speed of the platform, (n,) [m/s]; zero at both ends of each item."""
    speed = np.zeros(len(world.time))
    for number in range(len(world.items)):
        rows = np.flatnonzero(world.item == number)
        rates = np.gradient(world.stand.place[rows], world.time[rows], axis=0)
        speed[rows] = np.linalg.norm(rates, axis=1)
    return speed


def _torque(world: World) -> Array:
    return world.moments(world.kind.nothing())


_OF_JOINTS: dict[str, Callable[[World], Array]] = {
    "q": lambda world: world.command,
    "rate": lambda world: world.velocity,
    "acceleration": lambda world: world.acceleration,
    "direction": _direction,
    "travel": _travel,
    "torque": _torque,
}
_SHARED: dict[str, Callable[[World], Array]] = {
    "payload": lambda world: world.payload,
    "time": lambda world: world.time,
    "x": lambda world: world.stand.place[:, 0],
    "y": lambda world: world.stand.place[:, 1],
    "z": lambda world: world.stand.place[:, 2],
    "tilt": lambda world: 2 * np.arctan(np.linalg.norm(world.stand.gibbs, axis=1)),
    "speed": _speed,
}
