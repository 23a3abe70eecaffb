"""Measured streams of a cell, kept in memory until they are fitted."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import (
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
)

Array = NDArray[np.float64]

_BLOCK = 4096  # rows


class Capture:
    """Streams of one measurement, recorded between `start` and `stop`.

    At most `limit` messages of all streams together are recorded: others are counted as lost, and
    the session's notes say so. A payload stays valid until the next payload message, so the
    last one before the start is recorded as well.

    Args:
        names: (m,) names of the robot's joints, in the order of every position.
        limit: largest number of messages held.
    """

    def __init__(self, names: Sequence[str], limit: int) -> None:
        self._names = tuple(names)
        self._limit = limit
        self._payload_before: tuple[int, Array] | None = None
        self.running = False
        self._clear()

    def _clear(self) -> None:
        self.held = 0  # messages in all
        self.lost = 0  # messages beyond the limit
        self.strangers = 0  # tracker messages of another kind (point or pose) than the first one
        self._command = _Rows(len(self._names))
        self._states = _Rows(len(self._names))
        self._tracker: _Rows | None = None
        self._payload = _Rows(4)
        self._temperature: dict[str, _Rows] = {}

    def start(self) -> None:
        """Discard the messages held and start recording."""
        self._clear()
        self.running = True
        if self._payload_before is not None:
            self._take(self._payload, *self._payload_before)

    def stop(self) -> None:
        """Stop recording; the messages held are kept."""
        self.running = False

    @property
    def counts(self) -> dict[str, int]:
        """Messages held, by stream."""
        return {
            "joint_command": len(self._command),
            "joint_states": len(self._states),
            "tracker": 0 if self._tracker is None else len(self._tracker),
            "temperature": sum(map(len, self._temperature.values())),
            "payload": len(self._payload),
        }

    def add_command(self, stamp_ns: int, position: Array) -> None:
        """Record commanded nominal joint angles, (m,) [rad]."""
        self._take(self._command, stamp_ns, position)

    def add_states(self, stamp_ns: int, position: Array) -> None:
        """Record joint angles measured by the encoders, (m,) [rad]."""
        self._take(self._states, stamp_ns, position)

    def add_tracker(self, stamp_ns: int, position: Array, quaternion: Array | None = None) -> None:
        """Record a tracker reading: (3,) [m], and of a probe also a quaternion (4,) x y z w.

        The first reading decides whether this is a capture of points or of poses.
        """
        if not self.running:
            return
        row = position if quaternion is None else np.concatenate([position, quaternion])
        if self._tracker is None:
            self._tracker = _Rows(len(row))
        if self._tracker.width == len(row):
            self._take(self._tracker, stamp_ns, row)
        else:
            self.strangers += 1

    def add_temperature(self, part: str, stamp_ns: int, celsius: float) -> None:
        """Record the temperature [deg C] of a part of the cell."""
        if self.running:
            rows = self._temperature.setdefault(part, _Rows(1))
            self._take(rows, stamp_ns, np.array([celsius]))

    def add_payload(self, stamp_ns: int, mass: float, centre: Array) -> None:
        """Record the payload valid from now on: mass [kg], centre of mass (3,) [m]."""
        row = np.array([mass, *centre])
        self._payload_before = (stamp_ns, row)
        self._take(self._payload, stamp_ns, row)

    def frozen(self) -> Capture:
        """Cheap snapshot of the capture; its session may be made on another thread."""
        other = copy(self)
        other._command, other._states = self._command.frozen(), self._states.frozen()
        other._tracker = None if self._tracker is None else self._tracker.frozen()
        other._payload = self._payload.frozen()
        other._temperature = {part: rows.frozen() for part, rows in self._temperature.items()}
        return other

    def session(self, source: str) -> Session:
        """Copy the recorded messages into a session; later messages do not change it."""
        return Session(
            source=source,
            command=self._joints(self._command),
            states=self._joints(self._states),
            tracker=self._readings(),
            temperature=tuple(
                TemperatureStream(part, rows.stamps(), rows.values()[:, 0])
                for part, rows in self._temperature.items()
                if len(rows)
            ),
            payload=self._masses(),
            notes=self.notes(),
        )

    def notes(self) -> tuple[str, ...]:
        """Warnings about the recording, one sentence each."""
        notes = []
        if self.lost:
            notes.append(f"{self.lost} messages were lost: a capture holds {self._limit} at most")
        if self.strangers:
            notes.append(
                f"{self.strangers} tracker messages of the other kind (point, pose) left out"
            )
        back = sum(rows.backward for rows in self._streams())
        if back:
            notes.append(f"time went backwards {back} times")
        return tuple(notes)

    def _streams(self) -> list[_Rows]:
        tracker = [] if self._tracker is None else [self._tracker]
        parts = list(self._temperature.values())
        return [self._command, self._states, *tracker, self._payload, *parts]

    def _take(self, rows: _Rows, stamp_ns: int, row: Array) -> None:
        if not self.running:
            return
        if self.held >= self._limit:
            self.lost += 1
            return
        rows.append(stamp_ns, row)
        self.held += 1

    def _joints(self, rows: _Rows) -> JointStream | None:
        return JointStream(rows.stamps(), self._names, rows.values()) if len(rows) else None

    def _readings(self) -> TrackerStream | None:
        if self._tracker is None or not len(self._tracker):
            return None
        rows = self._tracker.values()
        quaternion = rows[:, 3:] if self._tracker.width == 7 else None
        return TrackerStream(self._tracker.stamps(), rows[:, :3], quaternion)

    def _masses(self) -> PayloadStream | None:
        rows = self._payload
        if not len(rows):
            return None
        values = rows.values()
        return PayloadStream(rows.stamps(), values[:, 0], values[:, 1:])


class _Rows:
    """Growing table of stamped rows of equal width, stored in compact blocks."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.backward = 0  # number of stamps earlier than their predecessor
        self._full: list[tuple[NDArray[np.int64], Array]] = []
        self._stamps, self._values = array("q"), array("d")
        self._last: int | None = None

    def __len__(self) -> int:
        return _BLOCK * len(self._full) + len(self._stamps)

    def append(self, stamp_ns: int, row: Array) -> None:
        if self._last is not None and stamp_ns < self._last:
            self.backward += 1
        self._last = stamp_ns
        self._stamps.append(stamp_ns)
        self._values.extend(row.tolist())
        if len(self._stamps) == _BLOCK:
            self._full.append((np.array(self._stamps), np.array(self._values)))
            self._stamps, self._values = array("q"), array("d")

    def frozen(self) -> _Rows:
        """Snapshot of the rows, unchanged by later appends; full blocks are shared."""
        other = copy(self)
        other._full = list(self._full)
        other._stamps, other._values = self._stamps[:], self._values[:]
        return other

    def stamps(self) -> NDArray[np.int64]:
        """Stamps, (n,) [ns]."""
        blocks = [stamps for stamps, _ in self._full]
        return np.concatenate([*blocks, np.array(self._stamps, dtype=np.int64)])

    def values(self) -> Array:
        """Values, (n, width)."""
        blocks = [values for _, values in self._full]
        rows = np.concatenate([*blocks, np.array(self._values, dtype=np.float64)])
        return rows.reshape(-1, self.width)
