"""A session of the bodies, in the form of a recorded one: commands, encoders, tracker, payload."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.data import JointStream, PayloadStream, Session, TrackerStream
from physics.bodies import CENTRE, STEP
from physics.machine import Machine
from physics.plan import EVERY, Item
from physics.rig import Rig

Array = NDArray[np.float64]

NAMES = ("joint_1", "joint_2", "joint_3")
_START_NS = 1_700_000_000_000_000_000
_BETWEEN = 20.0  # [s] between items
_REST, _ENCODER = 12e-6, 3e-6  # [rad] error at rest, drawn once per move; of an encoder reading
_RADIAL, _ACROSS, _PER_METRE = 3e-6, 2e-6, 2e-6  # [m], [m], [m/m]
_BEGIN = 0.5  # [s] for the machine to settle


def measured(machine: Machine, items: Sequence[Item], rng: np.random.Generator) -> Session:
    """Execute a plan on a machine and record it."""
    rig, reflector = Rig(machine), rng.uniform([-0.03, -0.03, -0.06], [0.03, 0.03, -0.02])
    times, commands, points, payloads = [], [], [], []
    begin, off = 0.0, np.zeros(3)
    rig.settle(np.zeros(3), items[0].payload, _BEGIN)
    for item in items:
        new = _REST * rng.standard_normal(3)
        share = np.linspace(0, 1, len(item.command))[:, None] ** 0.25
        place, turn = rig.follow(item.command + off + share * (new - off), item.payload, EVERY)
        off = new
        held = _Held(item, place + Rotation.from_quat(turn[:, [1, 2, 3, 0]]).apply(reflector))
        times.append(begin + held.time)
        commands.append(held.command)
        points.append(held.point)
        payloads.append((begin, item.payload))
        begin = held.time[-1] + begin + _BETWEEN
    time, command = np.concatenate(times), np.concatenate(commands)
    reading = _by_tracker(np.concatenate(points), rng)
    stamp, carried = _stamps(time), np.array(payloads)
    return Session(
        source="bodies",
        command=JointStream(stamp, NAMES, command),
        states=JointStream(stamp, NAMES, command + _ENCODER * rng.standard_normal(command.shape)),
        tracker=TrackerStream(stamp, reading),
        payload=PayloadStream(
            _stamps(carried[:, 0]), carried[:, 1], np.tile(CENTRE, (len(carried), 1))
        ),
    )


class _Held:
    """Readings of an item; a stop is measured repeatedly where it has settled."""

    def __init__(self, item: Item, point: Array) -> None:
        command = item.command[::EVERY]
        self.command = np.concatenate([command, np.tile(item.command[-1], (item.dwell, 1))])
        self.point = np.concatenate([point, np.tile(point[-1], (item.dwell, 1))])
        self.time = np.arange(len(self.command)) * EVERY * STEP


def _by_tracker(point: Array, rng: np.random.Generator) -> Array:
    """Readings of a tracker three metres away: little noise along its beam, more across it."""
    bearing = rng.uniform(0, 2 * np.pi)
    turn = Rotation.from_euler("zyx", [rng.uniform(0, 2 * np.pi), *rng.normal(0, 0.02, 2)])
    station = np.array([3.0 * np.cos(bearing), 3.0 * np.sin(bearing), rng.uniform(-0.5, 0.3)])
    seen = turn.apply(point - station)
    far = np.linalg.norm(seen, axis=1, keepdims=True)
    raw = rng.standard_normal(seen.shape)
    along = np.sum(raw * seen, axis=1, keepdims=True) * seen / far**2
    return np.asarray(seen + _RADIAL * along + (_ACROSS + _PER_METRE * far) * (raw - along))


def _stamps(time: Array) -> NDArray[np.int64]:
    return _START_NS + np.round(time * 1e9).astype(np.int64)
