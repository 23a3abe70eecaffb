"""Timeline and clock of the playback of a session, without ROS.

Session time t is piecewise linear in wall time w, with a new piece at every change of rate or
pause:

    t(w) = t_k + rate (w - w_k)
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError, RecordingError
from delta_calibration.recording import read_messages

ALL = "*"


@dataclass(frozen=True)
class Timeline:
    """The messages of a session in the order of their log times."""

    topics: tuple[str, ...]  # (m,) names as recorded
    type_names: tuple[str, ...]  # (m,)
    log_time_ns: NDArray[np.int64]  # (n,) [ns], rising
    topic: NDArray[np.intp]  # (n,) index into `topics`
    records: tuple[bytes, ...]  # (n,) serialized messages
    notes: tuple[str, ...]  # warnings about messages lost or left out in reading

    @property
    def start_ns(self) -> int:
        """Log time of the first message."""
        return int(self.log_time_ns[0])

    @property
    def end_ns(self) -> int:
        """Log time of the last message."""
        return int(self.log_time_ns[-1])

    def first_at(self, time_ns: int) -> int:
        """Index of the first message that is not before this time."""
        return int(np.searchsorted(self.log_time_ns, time_ns, side="left"))

    def last_before(self, topic: int, stop: int) -> int | None:
        """Index of a topic's last message among the first `stop`; None if there is none."""
        found = np.flatnonzero(self.topic[:stop] == topic)
        return int(found[-1]) if found.size else None


def load_timeline(path: Path, wanted: tuple[str, ...] = (ALL,)) -> Timeline:
    """Read the messages to be played; of a truncated file, those that remain.

    Args:
        path: folder or file of the session.
        wanted: names of topics, with or without the leading slash; `*` for all.

    Raises:
        RecordingError: not readable, a topic that is not in it, or nothing to play.
    """
    messages, notes = read_messages(path)
    asked = {name.strip("/") for name in wanted}
    there = {message.topic.strip("/") for message in messages}
    if ALL not in asked and asked - there:
        raise RecordingError(
            f"{path} has no topic {', '.join(sorted(asked - there))}; it has {sorted(there)}"
        )
    chosen = [m for m in messages if ALL in asked or m.topic.strip("/") in asked]
    if not chosen:
        raise RecordingError(
            f"{path}: parameter topics names no topic to play; it has {sorted(there)}"
        )
    kinds = list(dict.fromkeys((m.topic, m.type_name) for m in chosen))
    index = {kind: i for i, kind in enumerate(kinds)}
    return Timeline(
        topics=tuple(topic for topic, _ in kinds),
        type_names=tuple(type_name for _, type_name in kinds),
        log_time_ns=np.array([m.log_time_ns for m in chosen], dtype=np.int64),
        topic=np.array([index[m.topic, m.type_name] for m in chosen], dtype=np.intp),
        records=tuple(m.data for m in chosen),
        notes=notes,
    )


def start_index(timeline: Timeline, offset_s: float) -> int:
    """Index of the first message at or after the offset [s] from the start.

    Raises:
        InputError: the offset lies past the end.
    """
    length_s = (timeline.end_ns - timeline.start_ns) * 1e-9
    if offset_s > length_s:
        raise InputError(f"parameter start: {offset_s} s, but the session lasts {length_s:.3f} s")
    return timeline.first_at(timeline.start_ns + round(offset_s * 1e9))


class PlaybackClock:
    """Session time [ns] as a function of wall time [ns].

    Args:
        session_ns: session time at the start [ns].
        wall_ns: present wall time [ns].
        rate: seconds of session time per second of wall time.
        paused: whether session time stands still.
    """

    def __init__(self, session_ns: int, wall_ns: int, rate: float, paused: bool) -> None:
        self._session_ns = session_ns
        self._wall_ns = wall_ns
        self._rate = 0.0 if paused else rate

    def at(self, wall_ns: int) -> int:
        """Session time [ns] at the wall time `wall_ns`."""
        return self._session_ns + int(self._rate * (wall_ns - self._wall_ns))

    def change(self, wall_ns: int, rate: float, paused: bool) -> None:
        """Continue at another rate from this wall time on, or pause."""
        self._session_ns, self._wall_ns = self.at(wall_ns), wall_ns
        self._rate = 0.0 if paused else rate
