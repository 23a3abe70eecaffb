"""A machine with its causes in front of a tracker; measures any plan without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause
from blind.delta import DELTA
from blind.kind import Kind
from blind.plans import Item
from blind.tracker import Tracker
from blind.world import State, Warming, World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """Noise-free readings with and without the causes."""

    world: World
    state: State
    reading: Array  # (n, 3) [m]
    plain: Array  # (n, 3) [m]


@dataclass(frozen=True)
class Cell:
    """One machine, and the duration of its session, over which drifts extend."""

    build: Any
    plain: Any  # without the causes
    causes: tuple[Cause, ...]
    tracker: Tracker
    warming: Warming
    length: float  # [s]
    scatter: float  # manufacturing errors in units of the tolerances
    kind: Kind = DELTA

    @classmethod
    def drawn(
        cls,
        causes: tuple[Cause, ...],
        rng: np.random.Generator,
        scatter: float,
        length: float,
        kind: Kind = DELTA,
    ) -> Cell:
        """Draw a machine within manufacturing errors and add the causes."""
        plain = kind.manufactured(rng, scatter)
        build = plain
        for cause in causes:
            build = cause.rebuild(build)
        tracker = Tracker.drawn(rng, kind)
        warming = Warming.drawn(rng, kind.rise, kind.constant)
        return cls(build, plain, causes, tracker, warming, length, scatter, kind)

    def only(self, cause: Cause) -> Cell:
        """The same machine with only one of its causes."""
        return replace(self, causes=(cause,), build=cause.rebuild(self.plain))

    def measure(self, items: Sequence[Item]) -> Measured:
        """Execute a plan."""
        world = self._world(items, self.build)
        state = State.untouched(world)
        for cause in self.causes:
            cause.act(world, state)
        plain = world if self.build is self.plain else self._world(items, self.plain)
        without = self.tracker.sees(plain, State.untouched(plain))
        return Measured(world, state, self.tracker.sees(world, state), without)

    def _world(self, items: Sequence[Item], build: Any) -> World:
        return World(items, build, self.warming, self.length, self.kind)
