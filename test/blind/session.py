"""A session with something hidden in it, and the truth for judging what is found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause
from blind.causes import draw
from blind.cell import Cell, Measured
from blind.kinds import KINDS
from blind.plans import PLANS, held_out
from blind.signal import Left, Signal, left, lefts, signal
from blind.world import State, World
from delta_calibration.data import (
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
)

Array = NDArray[np.float64]

_START_NS = 1_750_000_000_000_000_000
_ROOM = 20.0  # [deg C]
_SENSOR = 0.02  # [K]
_SENSED = 30.0  # [s] between two temperature readings
_STIRRED = 1e-9  # [m]


@dataclass(frozen=True)
class Truth:
    """Behaviour of the machine at places and in conditions that the session did not contain.

    `point` is the noise-free position that the tracker would measure, `plain` the same for the
    machine without its hidden causes; for stops (one row each) and measured motions.
    """

    session: Session  # the same as streams; with noise, since exact repeats would count as frozen
    time: Array  # (n,) [s]
    command: Array  # (n, m) [rad]
    velocity: Array  # (n, m) [rad/s]
    side: Array  # (n,) -1 or 1 side of approach, 0 in motion
    payload: Array  # (n,) [kg]
    point: Array  # (n, 3) [m]
    plain: Array  # (n, 3) [m]


@dataclass(frozen=True)
class Hidden:
    """Information for the judge, by the names of the causes."""

    causes: tuple[str, ...]
    location: dict[str, str | None]
    values: dict[str, Mapping[str, float | str]]
    signal_um: float


@dataclass(frozen=True)
class Trial:
    """A session, the causes hidden in it, and the size of their signal."""

    session: Session
    causes: tuple[Cause, ...]
    signals: Signal
    cell: Cell = field(repr=False)
    measured: Measured = field(repr=False)
    _seed: int = field(repr=False)
    _sensors: tuple[str, ...] = field(repr=False)

    @property
    def signal(self) -> float:
        """RMS displacement of the points by the causes, at stops or in motion, the larger [um]."""
        return max(self.signals.still, self.signals.moving)

    @cached_property
    def left(self) -> Left:
        """What a calibration leaves of the signal; computed when first used."""
        return left(self.cell, self.measured)

    @cached_property
    def strengths(self) -> dict[str, float]:
        """Lambda of each cause alone, as `Left.strength`."""
        if len(self.causes) == 1:
            return {self.causes[0].name: self.left.strength}
        items = self.measured.world.items
        every = [self.cell.only(cause).measure(items) for cause in self.causes]
        parts = lefts(self.cell, every) if every else []
        names = (cause.name for cause in self.causes)
        return {name: part.strength for name, part in zip(names, parts, strict=True)}

    @cached_property
    def truth(self) -> Truth:
        """The machine at held-out places; computed when first used."""
        carried = sorted({item.payload for item in self.measured.world.items})
        rng = np.random.default_rng([self._seed, 4])
        return _truth(self.cell, carried, self._sensors, rng)

    @property
    def hidden(self) -> Hidden:
        """The hidden causes by name."""
        return Hidden(
            tuple(cause.name for cause in self.causes),
            {cause.name: cause.location for cause in self.causes},
            {cause.name: cause.values for cause in self.causes},
            self.signal,
        )


def hide(
    causes: Mapping[str, float] | Iterable[str],
    seed: int,
    plan: str = "rich",
    scatter: float = 1.0,
    sensors: tuple[str, ...] | None = None,
    robot: str = "srbd",
    again: int = 0,
) -> Trial:
    """Make a session of a machine with these causes; the same for the same arguments.

    Machine, plan and noise depend on the seed and not on the causes.

    Args:
        causes: in the syntax of `causes.draw`, each with its strength (1 if only named) in units
            of a real machine's typical size.
        seed: of the machine, the plan, the causes and the noise.
        plan: one of `plans.PLANS`.
        scatter: size of the manufacturing errors in units of the tolerances.
        sensors: parts whose temperature is recorded (of a Delta arm, base, forearm); by default
            those that such a machine usually has.
        robot: one of `kinds.KINDS`.
        again: number of earlier measurements of the same machine, each with other noise.
    """
    asked = causes if isinstance(causes, Mapping) else dict.fromkeys(causes, 1.0)
    of_cell, of_plan, of_causes = (np.random.default_rng([seed, k]) for k in range(3))
    of_noise = np.random.default_rng([seed, 3, again] if again else [seed, 3])
    kind = KINDS[robot]
    hidden = tuple(draw(name, strength, of_causes, robot) for name, strength in asked.items())
    items = PLANS[plan](of_plan, kind)
    cell = Cell.drawn(hidden, of_cell, scatter, items[-1].begin, kind)
    measured = cell.measure(items)
    rest = (
        kind.rest * of_noise.standard_normal((len(items), len(kind.joints)))[measured.world.item]
    )
    seen = cell.tracker.sees(measured.world, _moved(measured.state, rest))
    noisy = seen + cell.tracker.noise(seen, of_noise)
    usual = kind.sensors if sensors is None else sensors
    sensors = () if plan == "no_temperatures" else usual
    session = _streams(measured.world, noisy, kind.encoder, sensors, of_noise)
    return Trial(session, hidden, signal(measured), cell, measured, seed, sensors)


def _moved(state: State, by: Array) -> State:
    return State(
        state.joint + by, state.changed, state.late, state.offset, state.shift, state.distortions
    )


def _truth(
    cell: Cell, payloads: Sequence[float], sensors: tuple[str, ...], rng: np.random.Generator
) -> Truth:
    measured = cell.measure(held_out(rng, cell.kind, cell.length / 3600, payloads))
    world = measured.world
    stirred = _STIRRED * rng.standard_normal(measured.reading.shape)
    last = np.diff(world.item, append=-1) != 0
    rows = np.flatnonzero(np.where(world.still, last, world.side == 0))
    return Truth(
        session=_streams(world, measured.reading + stirred, 0.0, sensors, rng),
        time=world.time[rows],
        command=world.command[rows],
        velocity=world.velocity[rows],
        side=world.side[rows],
        payload=world.payload[rows],
        point=measured.reading[rows],
        plain=measured.plain[rows],
    )


def _streams(
    world: World,
    reading: Array,
    encoder: float,
    sensors: tuple[str, ...],
    rng: np.random.Generator,
) -> Session:
    stamp, kind = _stamps(world.time), world.kind
    angle = world.command + encoder * rng.standard_normal(world.command.shape)
    carried = np.flatnonzero(np.diff(world.payload, prepend=-1.0))
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (int(world.seen.sum()), 1))
    sensed = np.arange(0.0, world.time.max() + _SENSED, _SENSED)
    noise = _SENSOR * (encoder > 0) * rng.standard_normal((len(sensors), len(sensed)))
    return Session(
        source="blind",
        command=JointStream(stamp, kind.joints, world.command),
        states=JointStream(stamp, kind.joints, angle),
        tracker=TrackerStream(stamp[world.seen], reading[world.seen], upright),
        temperature=tuple(
            TemperatureStream(
                part, _stamps(sensed), _ROOM + world.warming.by_sensor(part, sensed) + noise[k]
            )
            for k, part in enumerate(sensors)
        ),
        payload=PayloadStream(
            stamp[carried], world.payload[carried], np.tile(kind.centre, (len(carried), 1))
        ),
    )


def _stamps(time: Array) -> NDArray[np.int64]:
    return _START_NS + np.round(time * 1e9).astype(np.int64)
