"""Convert a user's table to a session: its rows become streams as a cell would record them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data.streams import (
    ASSUMED_INTERVAL,
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
)
from delta_calibration.plans.motion import APPROACH
from delta_calibration.recording.table_mapping import TableMapping
from delta_calibration.recording.table_numbers import STOP, TableNumbers, read_numbers
from delta_calibration.recording.table_units import require_units
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

_LEAD_NS = 1_000_000_000  # [ns] before the first row, for the approach to it


def session_of_table(path: Path, mapping: TableMapping, robot: Robot) -> Session:
    """Session made from a table.

    Each row gives a command and the measurement there. Rows in motion give commands only. If a
    row has directions of approach, a command short of it is inserted before it. If the table has
    no times, the session's metadata say which interval of its rows was assumed.

    Raises:
        InputError: the table does not have the mapping's form, or has numbers that are impossible
            for the robot; names file, line, column and value.
    """
    tracker = robot.tracker
    sigma = min(tracker.radial, tracker.transverse)
    numbers = read_numbers(path, mapping, sigma)
    doubts = require_units(numbers, mapping, robot)
    names, at = robot.joints.names, np.round(numbers.time * 1e9).astype(np.int64)
    if numbers.direction is not None and at[0] < _LEAD_NS:  # no stamp is before zero
        at = at + _LEAD_NS
    rest = ~numbers.moves
    turn = numbers.quaternion
    timed = mapping.time is not None or mapping.row_interval is not None
    session = Session(
        source=str(path),
        command=_commands(numbers, at, robot),
        states=None if numbers.encoder is None else JointStream(at, names, numbers.encoder),
        tracker=TrackerStream(
            at[rest], numbers.position[rest], None if turn is None else turn[rest]
        ),
        temperature=tuple(
            TemperatureStream(part, at, numbers.temperature[:, k])
            for k, (part, _) in enumerate(mapping.temperature)
        ),
        payload=None if numbers.payload is None else _payloads(numbers.payload, at),
        metadata={} if timed else {ASSUMED_INTERVAL: f"{STOP:g}"},
    )
    notes = (*numbers.notes, *doubts, session.clock_note)
    return replace(session, notes=tuple(filter(None, notes)))


def _commands(numbers: TableNumbers, at: Stamps, robot: Robot) -> JointStream:
    """Command of each row; if a direction is given, preceded by a command short of it."""
    names, command = robot.joints.names, numbers.command
    if numbers.direction is None:
        return JointStream(at, names, command)
    before = np.concatenate([at[:1] - _LEAD_NS, at[:-1]])
    short = command - numbers.direction * APPROACH * robot.commanded.joint_size
    stamps = np.concatenate([(before + at) // 2, at])
    order = np.argsort(stamps, kind="stable")
    return JointStream(stamps[order], names, np.concatenate([short, command])[order])


def _payloads(mass: Array, at: Stamps) -> PayloadStream:
    """One message for each change of the payload; its centre is at the platform's origin."""
    change = np.flatnonzero(np.diff(mass, prepend=np.nan) != 0)
    return PayloadStream(at[change], mass[change], np.zeros((len(change), 3)))
