"""Causes of any machine: wrong dimensions, and structure that is in no catalogue."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.kind import Kind, at
from blind.world import State, World

Array = NDArray[np.float64]
Where = tuple[str, tuple[int, ...]]  # part of a build, and index in it

_TURN = 1e-4  # [rad of a Delta]
_GIVE = 1 / 2.5e4  # [rad/(N m)] of a drive


def dimension(name: str, limb: str, typical: float, choices: Mapping[int, list[Where]]) -> Draw:
    """One dimension, wrong by about `typical`; choices by the number of its joint or cable."""

    def draw(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
        able = [leg for leg in choices if legs[leg - 1]]
        leg = int(rng.choice(able))
        part, where = choices[leg][int(rng.integers(len(choices[leg])))]
        size = float(strength * typical * rng.choice([-1.0, 1.0]))
        return Cause(
            name,
            values={f"{part}_{leg}": size},
            location=f"{limb}_{leg}",
            rebuild=lambda build: at(build, part, where, size),
        )

    return draw


def in_no_catalogue(kind: Kind) -> dict[str, Draw]:
    """Structure by place, by load or by another joint's motion, as large as on the Delta."""
    stops = kind.assemble(
        kind.command(kind.places(np.random.default_rng(0), 200)), kind.drawing()
    ).place
    middle, reach = stops.mean(axis=0), stops.std(axis=0) + 1e-3
    joints = kind.command(kind.places(np.random.default_rng(1), 200))
    span = joints.std(axis=0)

    def bump(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
        """Obstacles at a few places of the workspace push the platform aside."""
        where = middle + reach * rng.standard_normal((4, 3))
        width, push = rng.uniform(0.5, 0.9, 4), strength * 80e-6 * rng.standard_normal((4, 3))

        def act(world: World, state: State) -> None:
            apart = (world.stand.place[:, None] - where) / reach
            near2 = np.sum(apart**2, axis=2)
            state.shift = state.shift + np.exp(-near2 / (2 * width**2)) @ push

        return Cause("unknown", act, {"kind": "bump"})

    def grip(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
        """The platform bends where the payload is held, in a direction depending on the place."""
        waves, phase = rng.uniform(1.2, 2.0, (3, 3)) / reach, rng.uniform(0, 2 * np.pi, 3)
        size = strength * 60e-6  # [m] with the payload

        def act(world: World, state: State) -> None:
            bent = np.sin((world.stand.place - middle) @ waves.T + phase)
            state.shift = state.shift + size * world.payload[:, None] / kind.heavy * bent

        return Cause("unknown", act, {"kind": "grip"})

    def ripple(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
        """A random smooth field in joint space, from plane waves."""
        m = len(kind.joints)
        waves = 1.5 * rng.standard_normal((m, 8, m)) / (span * np.sqrt(m))
        phase, size = rng.uniform(0, 2 * np.pi, (m, 8)), strength * 50e-6 * kind.size

        def act(world: World, state: State) -> None:
            angle = np.einsum("nj,lwj->nlw", world.command, waves) + phase
            state.joint += size * np.sin(angle).sum(axis=2)

        return Cause("unknown", act, {"kind": "ripple"})

    def cross_talk(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
        """The error of a joint depends on its neighbour's angle."""
        m = len(kind.joints)
        size = strength * 0.12e-3 * kind.size * rng.uniform(0.6, 1.4, m)
        phase, cycles = rng.uniform(0, 2 * np.pi, m), rng.uniform(1.5, 3.0, m)

        def act(world: World, state: State) -> None:
            neighbour = np.roll((world.command - joints.mean(axis=0)) / span, 1, axis=1)
            state.joint += size * np.sin(cycles * neighbour + phase)

        return Cause("unknown", act, {"kind": "cross_talk"})

    return {"bump": bump, "grip": grip, "ripple": ripple, "cross_talk": cross_talk}
