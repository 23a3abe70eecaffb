"""Structure in no catalogue, which a diagnosis must detect and must not name.

About 40 to 80 micrometres each, by place, by load or by another joint's motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.machine import assemble
from blind.truth import (
    BASE,
    DRIVE,
    JOINTS,
    MEASUREMENT,
    PLATFORM,
    STRUCTURE,
    TRACKER,
    Law,
    Truth,
    of_each,
    of_shift,
    place,
    true,
)
from blind.world import State, World

Array = NDArray[np.float64]

_GIVE = 1 / 2.5e4  # [rad/(N m)] of a drive
_TURN = 1e-4  # [rad]
_ANYWHERE = f"{STRUCTURE} {MEASUREMENT}"
_ANY = f"{PLATFORM} {BASE} {TRACKER}"
_ONE_READING = "a tracker that reads one point cannot tell a shift of base, platform or reading"


def _shifted(variables: str, form: str | None, law: Law) -> Truth:
    return true(_ANYWHERE, _ANY, variables, form, law, _ONE_READING)


def bump(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Obstacles at a few places of the workspace push the platform aside."""
    count = 4
    bearing, reach = rng.uniform(0, 2 * np.pi, count), rng.uniform(0.05, 0.35, count)
    height, width = rng.uniform(-0.84, -0.64, count), rng.uniform(0.08, 0.16, count)
    where = np.stack([reach * np.cos(bearing), reach * np.sin(bearing), height], axis=1)
    push = strength * 80e-6 * rng.standard_normal((count, 3))  # [m]

    def pushed(points: Array) -> Array:
        near2 = np.sum((points[:, None] - where) ** 2, axis=2)
        return np.exp(-near2 / (2 * width**2)) @ push

    def act(world: World, state: State) -> None:
        state.shift = state.shift + pushed(world.stand.place)

    truth = _shifted("x y z", None, of_shift(lambda seen: pushed(place(seen))))
    return Cause("unknown", act, {"kind": "bump"}, truth=truth)


def ripple(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A random smooth field in joint space, from plane waves."""
    waves, size = 5.0 * rng.standard_normal((3, 8, 3)), strength * 50e-6
    phase = rng.uniform(0, 2 * np.pi, (3, 8))

    def moved(command: Array) -> Array:
        angle = np.einsum("nj,lwj->nlw", command, waves) + phase
        return np.asarray(size * np.sin(angle).sum(axis=2))

    def act(world: World, state: State) -> None:
        state.joint += moved(world.command)

    truth = true(DRIVE, JOINTS, "q_j q_j+1 q_j+2", None, _of_angles(moved))
    return Cause("unknown", act, {"kind": "ripple"}, truth=truth)


def _of_angles(moved: Callable[[Array], Array]) -> Law:
    """A law that moves each joint by a function of all joint angles."""

    def law(seen: Mapping[str, Array]) -> dict[str, Array]:
        columns = moved(np.stack([seen[f"q_{joint}"] for joint in (1, 2, 3)], axis=1)).T
        return {f"dq_{joint + 1}": column for joint, column in enumerate(columns)}

    return law


def drag(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A hose hangs from a bracket beside the base; when taut it pulls on compliant drives."""
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

    by_place = true(f"{DRIVE} {STRUCTURE}", f"{JOINTS} {PLATFORM} {BASE}", "x y z", None, None)
    why = "the pull goes by the platform's place, which is where the joints are"
    truth = true(DRIVE, JOINTS, "q_j q_j+1 q_j+2", None, None, why, (by_place,))
    return Cause("unknown", act, {"kind": "drag"}, truth=truth)


def cross_talk(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The error of a joint depends on its neighbour's angle."""
    size, phase = strength * 0.12e-3 * rng.uniform(0.6, 1.4, 3), rng.uniform(0, 2 * np.pi, 3)
    cycles, way = rng.uniform(4, 8, 3), int(rng.choice([1, 2]))

    def act(world: World, state: State) -> None:
        state.joint += size * np.sin(cycles * np.roll(world.command, way, axis=1) + phase)

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        leg = joint - 1
        neighbour = seen[f"q_{(leg - way) % 3 + 1}"]
        return size[leg] * np.sin(cycles[leg] * neighbour + phase[leg])

    truth = true(DRIVE, JOINTS, f"q_j+{3 - way}", "sine", of_each("q", [1, 2, 3], one))
    return Cause("unknown", act, {"kind": "cross_talk"}, truth=truth)


def grip(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The platform bends where the payload is held, in a direction depending on the place."""
    waves, phase = rng.uniform(6, 10, (3, 3)), rng.uniform(0, 2 * np.pi, 3)
    size = strength * 60e-6  # [m] with 2 kg

    def bent(points: Array, payload: Array) -> Array:
        return np.asarray(size * payload[:, None] / 2.0 * np.sin(points @ waves.T + phase))

    def act(world: World, state: State) -> None:
        state.shift = state.shift + bent(world.stand.place, world.payload)

    law = of_shift(lambda seen: bent(place(seen), seen["payload"]))
    truth = _shifted("payload x y z", "product", law)
    return Cause("unknown", act, {"kind": "grip"}, truth=truth)


def rub(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Beyond an angle an arm rubs on its cover, and lags in proportion to the excess."""
    begins, size = rng.uniform(0.05, 0.3, 3), strength * 0.8e-3 * rng.uniform(0.6, 1.4, 3)

    def act(world: World, state: State) -> None:
        state.joint -= size * np.clip(world.command - begins, 0.0, 0.25)

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        beyond = np.clip(seen[f"q_{joint}"] - begins[joint - 1], 0.0, 0.25)
        return -size[joint - 1] * beyond

    truth = true(DRIVE, JOINTS, "q_j", "dead zone", of_each("q", [1, 2, 3], one))
    return Cause("unknown", act, {"kind": "rub"}, truth=truth)


def rocking(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The frame stands on three of its four feet and tips as the platform moves across."""
    bearing, soft = rng.uniform(0, 2 * np.pi), 0.05  # [rad], [m]
    across = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    axis, size = np.cross(across, [0.0, 0.0, 1.0]), strength * 70e-6  # [rad]

    def turns(points: Array) -> Array:
        return np.asarray(size * np.tanh(points @ across / soft)[:, None] * axis)

    def shifts(points: Array) -> Array:
        return np.cross(turns(points), points)

    def act(world: World, state: State) -> None:
        state.shift = state.shift + shifts(world.stand.place)

    turning = true(STRUCTURE, BASE, "x y", "saturation", of_shift(lambda s: turns(place(s))))
    why = f"{_ONE_READING}; a turn of the base is said shorter as a turn"
    law = of_shift(lambda seen: shifts(place(seen)))
    truth = true(_ANYWHERE, _ANY, "x y z", "saturation", law, why, (turning,))
    return Cause("unknown", act, {"kind": "rocking"}, truth=truth)


UNKNOWN: dict[str, Draw] = {
    "bump": bump,
    "ripple": ripple,
    "drag": drag,
    "cross_talk": cross_talk,
    "grip": grip,
    "rub": rub,
    "rocking": rocking,
}
