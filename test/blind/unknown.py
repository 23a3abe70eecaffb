"""What is in nobody's catalogue: structure that a diagnosis must see, and must not name.

About 40 to 80 micrometres each, by place, by load or by what another joint does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.machine import assemble
from blind.world import State, World

Array = NDArray[np.float64]

_GIVE = 1 / 2.5e4  # [rad/(N m)] of a drive
_TURN = 1e-4  # [rad]


def bump(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Something is in the way at a few places of the workspace, and pushes aside."""
    count = 4
    bearing, reach = rng.uniform(0, 2 * np.pi, count), rng.uniform(0.05, 0.35, count)
    height, width = rng.uniform(-0.84, -0.64, count), rng.uniform(0.08, 0.16, count)
    where = np.stack([reach * np.cos(bearing), reach * np.sin(bearing), height], axis=1)
    push = strength * 80e-6 * rng.standard_normal((count, 3))  # [m]

    def act(world: World, state: State) -> None:
        for centre, wide, by in zip(where, width, push, strict=True):
            near2 = np.sum((world.stand.place - centre) ** 2, axis=1)
            state.shift = state.shift + np.exp(-near2 / (2 * wide**2))[:, None] * by

    return Cause("unknown", act, {"kind": "bump"})


def ripple(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A random smooth field in joint space, from plane waves."""
    waves, size = 5.0 * rng.standard_normal((3, 8, 3)), strength * 50e-6
    phase = rng.uniform(0, 2 * np.pi, (3, 8))

    def act(world: World, state: State) -> None:
        angle = np.einsum("nj,lwj->nlw", world.command, waves) + phase
        state.joint += size * np.sin(angle).sum(axis=2)

    return Cause("unknown", act, {"kind": "ripple"})


def drag(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A hose hangs from a bracket beside the base; where it is taut it pulls on springy drives."""
    bearing, slack = rng.uniform(0, 2 * np.pi), 0.6  # [rad], [m]
    bracket = np.array([0.5 * np.cos(bearing), 0.5 * np.sin(bearing), -0.3])
    stiffness = strength * 80.0  # [N/m]

    def stored(q: Array, world: World) -> Array:
        place = assemble(q, world.build, None, world.stand).place
        taut = np.clip(np.linalg.norm(place - bracket, axis=1) - slack, 0.0, None)
        return stiffness * taut**2 / 2

    def act(world: World, state: State) -> None:
        for leg, joint in enumerate(np.eye(3)):
            up, down = (stored(world.command + s * _TURN * joint, world) for s in (1, -1))
            state.joint[:, leg] -= _GIVE * (up - down) / (2 * _TURN)

    return Cause("unknown", act, {"kind": "drag"})


def cross_talk(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A joint's error goes with its neighbour's angle."""
    size, phase = strength * 0.12e-3 * rng.uniform(0.6, 1.4, 3), rng.uniform(0, 2 * np.pi, 3)
    cycles, way = rng.uniform(4, 8, 3), int(rng.choice([1, 2]))

    def act(world: World, state: State) -> None:
        state.joint += size * np.sin(cycles * np.roll(world.command, way, axis=1) + phase)

    return Cause("unknown", act, {"kind": "cross_talk"})


def grip(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The platform bends where the payload is held, here this way and there that."""
    waves, phase = rng.uniform(6, 10, (3, 3)), rng.uniform(0, 2 * np.pi, 3)
    size = strength * 60e-6  # [m] with 2 kg

    def act(world: World, state: State) -> None:
        bent = np.sin(world.stand.place @ waves.T + phase)
        state.shift = state.shift + size * world.payload[:, None] / 2.0 * bent

    return Cause("unknown", act, {"kind": "grip"})


def rub(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """An arm rubs on its cover beyond an angle, and stays back the more the farther."""
    begins, size = rng.uniform(0.05, 0.3, 3), strength * 0.8e-3 * rng.uniform(0.6, 1.4, 3)

    def act(world: World, state: State) -> None:
        state.joint -= size * np.clip(world.command - begins, 0.0, 0.25)

    return Cause("unknown", act, {"kind": "rub"})


def rocking(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The frame stands on three feet of four and tips as the platform goes across."""
    bearing, soft = rng.uniform(0, 2 * np.pi), 0.05  # [rad], [m]
    across = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    axis, size = np.cross(across, [0.0, 0.0, 1.0]), strength * 70e-6  # [rad]

    def act(world: World, state: State) -> None:
        tipped = size * np.tanh(world.stand.place @ across / soft)
        turn = tipped[:, None] * axis
        state.shift = state.shift + np.cross(turn, world.stand.place)

    return Cause("unknown", act, {"kind": "rocking"})


UNKNOWN: dict[str, Draw] = {
    "bump": bump,
    "ripple": ripple,
    "drag": drag,
    "cross_talk": cross_talk,
    "grip": grip,
    "rub": rub,
    "rocking": rocking,
}
