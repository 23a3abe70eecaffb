"""A session with something hidden in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from blind.causes import ACTS, BUILT, UNKNOWN, State, World, misbuilt
from blind.machine import Build, Changed, assemble, manufactured
from blind.plans import PLANS, Item
from delta_calibration.samples import (
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
)

Array = NDArray[np.float64]

NAMES = ("joint_1", "joint_2", "joint_3")
_START_NS = 1_750_000_000_000_000_000
_REST = 12e-6  # [rad] where a joint comes to rest, one draw a move
_ENCODER = 3e-6  # [rad]
_RADIAL, _ACROSS, _PER_METRE = 3e-6, 2e-6, 2e-6  # [m], [m], [m/m]
_GROSS = 0.002  # share of readings that are clipped or bounced


@dataclass(frozen=True)
class Hidden:
    """What the judge knows."""

    causes: tuple[str, ...]
    location: dict[str, str | None]
    values: dict[str, Any]
    signal_um: float  # root mean square by which the hidden effects move the readings at rest


@dataclass(frozen=True)
class Trial:
    """A session and what is hidden in it."""

    session: Session
    hidden: Hidden


def hide(
    causes: Mapping[str, float],
    seed: int,
    plan: str = "rich",
    scatter: float = 1.0,
    temperatures: bool = True,
) -> Trial:
    """A session of a machine with these causes, each with its strength, in it.

    Args:
        causes: name -> strength in units of a real machine's typical size; `unknown:KIND` for what
            is in no catalogue.
        seed: of the machine, the plan and the noise.
        plan: one of `PLANS`.
        scatter: size of the manufacturing errors in units of the tolerances.
        temperatures: whether the sensors are recorded.
    """
    rng = np.random.default_rng(seed)
    build, location = manufactured(rng, scatter), {}
    for cause, strength in causes.items():
        if cause in BUILT:
            build, leg = misbuilt(build, cause, strength, rng)
            location[cause] = f"joint_{leg + 1}"
    items = PLANS[plan](rng)
    world = _world(items, build)
    state = State(world.command.copy(), Changed.nothing(len(world.time)))
    for cause, strength in causes.items():
        act = ACTS.get(cause) or UNKNOWN.get(cause.removeprefix("unknown:"))
        if act is not None:
            act(world, state, strength, rng)
            location[cause] = None
    tracker = _Tracker(rng)
    clean = tracker.sees(world.command, Changed.nothing(len(world.time)), world, State(
        world.command, Changed.nothing(len(world.time))))  # fmt: skip
    moved = tracker.sees(state.joint, state.changed, world, state)
    resting = np.concatenate([i.seen for i in items]) & ~world.moving
    signal = float(np.sqrt(np.mean(np.sum((moved - clean)[resting] ** 2, axis=1))))
    session = _recorded(items, world, state, tracker, rng, temperatures)
    hidden = Hidden(tuple(causes), location, dict(state.said), 1e6 * signal)
    return Trial(session, hidden)


def _world(items: list[Item], build: Build) -> World:
    time = np.concatenate([i.begin + i.time for i in items])
    warm = 1 - np.exp(-time / 2400.0)
    return World(
        time=time,
        item=np.repeat(np.arange(len(items)), [len(i.time) for i in items]),
        command=np.concatenate([i.command for i in items]),
        moving=np.repeat([i.moving for i in items], [len(i.time) for i in items]),
        payload=np.repeat([i.payload for i in items], [len(i.time) for i in items]),
        centre=np.array([0.0, 0.0, -0.03]),
        arm=13.0 * warm,
        base=4.5 * (1 - np.exp(-time / 3600.0)),
        forearm=8.0 * (1 - np.exp(-time / 1500.0)),
        build=build,
    )


class _Tracker:
    """A tracker three metres off, a reflector somewhere on the platform."""

    def __init__(self, rng: np.random.Generator) -> None:
        bearing = rng.uniform(0, 2 * np.pi)
        self.turn = Rotation.from_rotvec([0.02, -0.01, rng.uniform(0, 2 * np.pi)])
        self.place = np.array([3.0 * np.cos(bearing), 3.0 * np.sin(bearing), 0.4])
        self.reflector = 0.03 * rng.standard_normal(3)

    def sees(self, joint: Array, changed: Changed, world: World, state: State) -> Array:
        """Readings without noise, (n, 3) [m]."""
        stand = assemble(joint, world.build, changed)
        point = stand.place + stand.turn @ self.reflector
        reading = self.turn.apply(point) + self.place
        if state.late:
            reading = self._late(reading, world, state.late)
        reading = reading * (1 + state.scale)
        return reading if state.drift is None else state.drift(reading, world.time)

    def _late(self, reading: Array, world: World, late: float) -> Array:
        """What was true `late` before the stamp."""
        result = reading.copy()
        for number in np.unique(world.item[world.moving]):
            rows = np.flatnonzero(world.item == number)
            t = world.time[rows]
            speed = np.gradient(reading[rows], t, axis=0, edge_order=2)
            bend = np.gradient(speed, t, axis=0, edge_order=2)
            result[rows] = reading[rows] - late * speed + late**2 / 2 * bend
        return result

    def noise(self, reading: Array, rng: np.random.Generator) -> Array:
        """Along the beam little, across it with the distance; now and then gross."""
        distance = np.linalg.norm(reading, axis=1, keepdims=True)
        beam = reading / distance
        noise = (_ACROSS + _PER_METRE * distance) * rng.standard_normal(reading.shape)
        noise -= np.sum(noise * beam, axis=1, keepdims=True) * beam
        noise += _RADIAL * rng.standard_normal(distance.shape) * beam
        gross = rng.random(len(reading)) < _GROSS
        noise[gross] += rng.uniform(-1e-3, 1e-3, (int(gross.sum()), 3))
        return noise


def _recorded(
    items: list[Item],
    world: World,
    state: State,
    tracker: _Tracker,
    rng: np.random.Generator,
    temperatures: bool,
) -> Session:
    rest = _REST * rng.standard_normal((len(items), 3))
    joint = state.joint + rest[world.item]
    seen = np.concatenate([i.seen for i in items])
    reading = tracker.sees(joint, state.changed, world, state)
    reading = reading + tracker.noise(reading, rng)
    stamp = _START_NS + np.round(world.time * 1e9).astype(np.int64)
    encoder = world.command + _ENCODER * rng.standard_normal(world.command.shape)
    change = np.flatnonzero(np.r_[True, np.diff(world.payload) != 0])
    return Session(
        source="blind",
        command=JointStream(stamp, NAMES, world.command),
        states=JointStream(stamp, NAMES, encoder),
        tracker=TrackerStream(stamp[seen], reading[seen], None),
        temperature=_sensors(world, rng) if temperatures else (),
        payload=PayloadStream(
            stamp[change], world.payload[change], np.tile(world.centre, (len(change), 1))
        ),
    )


def _sensors(world: World, rng: np.random.Generator) -> tuple[TemperatureStream, ...]:
    """Two sensors, a minute behind their part; none on the forearms."""
    time = np.arange(0.0, world.time.max() + 60, 60.0)
    late = np.clip(time - 60.0, 0, None)
    stamp = _START_NS + np.round(time * 1e9).astype(np.int64)
    arm, base = 13.0 * (1 - np.exp(-late / 2400)), 4.5 * (1 - np.exp(-late / 3600))
    return tuple(
        TemperatureStream(part, stamp, 20.0 + t + 0.03 * rng.standard_normal(len(time)))
        for part, t in (("arm", arm), ("base", base))
    )
