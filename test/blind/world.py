"""Conditions of a session, sample by sample, and the state that the causes change."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.delta import DELTA
from blind.kind import Kind, Span, Stand
from blind.plans import Item
from blind.weight import Moved, torques

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CENTRE = DELTA.centre
_KNOT = 0.05  # [rad of a Delta] travel over which loads deviate from linear by 1 in 3000


@dataclass(frozen=True)
class Warming:
    """Temperature rise of each part over time [K]: first order."""

    rise: dict[str, float]  # [K]
    constant: dict[str, float]  # [s]
    lag: float  # [s] of a sensor behind its part

    @classmethod
    def drawn(
        cls,
        rng: np.random.Generator,
        rise: Mapping[str, Span] = DELTA.rise,
        constant: Mapping[str, Span] = DELTA.constant,
    ) -> Warming:
        """Draw a machine whose parts warm as far and as fast as is usual."""
        return cls(
            {part: rng.uniform(*span) for part, span in rise.items()},
            {part: rng.uniform(*span) for part, span in constant.items()},
            rng.uniform(20, 90),
        )

    def of(self, part: str, time: Array) -> Array:
        """Rise of the part itself, (n,) [K]."""
        return self.rise[part] * -np.expm1(-time / self.constant[part])

    def by_sensor(self, part: str, time: Array) -> Array:
        """Rise indicated by its sensor: a first-order lag of a first-order rise, (n,) [K]."""
        slow, quick = self.constant[part], self.lag
        share = (slow * np.exp(-time / slow) - quick * np.exp(-time / quick)) / (slow - quick)
        return self.rise[part] * (1 - share)


@dataclass(frozen=True)
class World:
    """All samples of a session, moves between poses included."""

    items: Sequence[Item]
    build: Any
    warming: Warming
    length: float  # [s] of a session of this machine
    kind: Kind = DELTA

    def _all(self, name: str) -> Array:
        return np.concatenate([getattr(item, name) for item in self.items])

    def _each(self, values: list[float]) -> Array:
        return np.repeat(values, [len(item.time) for item in self.items])

    @cached_property
    def item(self) -> Index:
        """Number of the item, (n,)."""
        return self._each(list(range(len(self.items)))).astype(np.int64)

    @cached_property
    def time(self) -> Array:
        """Time, (n,) [s]."""
        return self._each([item.begin for item in self.items]) + self._all("time")

    @cached_property
    def command(self) -> Array:
        """Joint commands, (n, m) [rad]."""
        return self._all("command")

    @cached_property
    def velocity(self) -> Array:
        """Joint velocities, (n, m) [rad/s]."""
        return self._all("velocity")

    @cached_property
    def acceleration(self) -> Array:
        """Joint accelerations, (n, m) [rad/s^2]."""
        return self._all("acceleration")

    @cached_property
    def still(self) -> NDArray[np.bool_]:
        """Whether it has arrived at a stop, (n,)."""
        return self._all("still").astype(bool)

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """Whether the tracker measures, (n,)."""
        return self._all("seen").astype(bool)

    @cached_property
    def payload(self) -> Array:
        """Payload, (n,) [kg]."""
        return self._each([item.payload for item in self.items])

    @cached_property
    def side(self) -> Array:
        """Side of approach to the stop, (n,) -1, 0, 1."""
        return self._each([item.side for item in self.items])

    @cached_property
    def stand(self) -> Stand:
        """The machine as built at its commands."""
        return self.kind.assemble(self.command, self.build)

    @cached_property
    def travel(self) -> Array:
        """Cumulative joint travel; a step between items prevents interpolation across them."""
        step = np.linalg.norm(np.diff(self.command, axis=0, prepend=self.command[:1]), axis=1)
        return np.cumsum(step) / self.kind.size + self.item

    def spread(self, of_rows: Callable[[Index], Array]) -> Array:
        """A slow function of the joints, computed at some rows and interpolated in between."""
        edge = np.flatnonzero(np.diff(self.item))
        near = np.flatnonzero(np.diff(np.floor(self.travel / _KNOT)))
        rows = np.unique(np.r_[0, edge, edge + 1, near, len(self.item) - 1])
        values = of_rows(rows)
        flat = values.reshape(len(rows), -1).T
        filled = [np.interp(self.travel, self.travel[rows], column) for column in flat]
        return np.stack(filled, axis=1).reshape(-1, *values.shape[1:])

    def moments(self, changed: Any) -> Array:
        """Torques at the joints by weight, and by inertia in motion, (n, m) [N m]."""

        def at(rows: Index) -> Array:
            q, payload, near = self.command[rows], self.payload[rows], self.stand.take(rows)
            changed_here, centre = changed.take(rows), self.kind.centre
            return torques(self.kind, q, self.build, changed_here, payload, centre, near)

        return self.spread(at) + self.pushes()

    def pulls(self, changed: Any) -> Array:
        """Tension of the rods, with inertia in motion, (n, 3, 2), or of the cables, (n, m) [N]."""

        def at(rows: Index) -> Array:
            q, payload, near = self.command[rows], self.payload[rows], self.stand.take(rows)
            changed_here, centre = changed.take(rows), self.kind.centre
            return self.kind.pulls(q, self.build, changed_here, payload, centre, near)

        result = self.spread(at)
        rows, moved = self._moved
        result[rows] += self.kind.pulls_of_motion(moved)
        return result

    def pushes(self) -> Array:
        """Torques of the inertia forces at the joints, (n, m) [N m]."""
        result = np.zeros_like(self.command)
        rows, moved = self._moved
        result[rows] = moved.moments()
        return result

    def payload_pushes(self) -> Array:
        """Inertia force of the payload, (n, 3) [N]."""
        result = np.zeros((len(self.time), 3))
        rows, moved = self._moved
        result[rows] = -moved.pushed[:, -1]
        return result

    @cached_property
    def _moved(self) -> tuple[Index, Moved]:
        """All samples in motion: their rows, and the motion."""
        rows = np.flatnonzero(~self.still)
        motion = (values[rows] for values in (self.command, self.velocity, self.acceleration))
        kind, near = self.kind, self.stand.take(rows)
        return rows, Moved(kind, *motion, self.build, self.payload[rows], kind.centre, near)


@dataclass
class State:
    """State of the machine that the causes change, one after the other."""

    joint: Array  # (n, m) behind the drives [rad]
    changed: Any
    late: float = 0.0  # [s] age of a reading at its stamp
    offset: Array | None = None  # (3,) [m] added to the reflector's offset
    shift: Array = field(default_factory=lambda: np.zeros((1, 3)))  # (n, 3) [m] in the base
    # (reading, time) -> reading, in the tracker's frame
    distortions: tuple[Callable[[Array, Array], Array], ...] = ()

    @classmethod
    def untouched(cls, world: World) -> State:
        """A machine that moves exactly as commanded."""
        return cls(world.command.copy(), world.kind.nothing())


Act = Callable[[World, State], None]
