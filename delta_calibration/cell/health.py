"""Health of a cell: a level, a sentence and the problems of its streams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

RECENT_S = 10.0  # [s] time for which a problem is reported
PAUSE_NS = 1_000_000_000  # [ns] commands farther apart do not form a stream


class Level(Enum):
    """Severity, the worst last."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Health:
    """Content of a diagnostics message."""

    level: Level
    message: str
    values: Mapping[str, object]


class Watch:
    """Monitors the streams: time of the last message of each, and their last problems."""

    def __init__(self) -> None:
        self._heard_s: dict[str, float] = {}
        self._troubles: dict[str, tuple[float, str]] = {}
        self.refused: dict[str, int] = {}
        self.lost: dict[str, int] = {}  # messages lost, as reported by the middleware
        self.late = 0  # commands that took longer than the time until the next one
        self.slowest_s = 0.0  # [s] longest time taken to process a command
        self._last_stamp: int | None = None

    def heard(self, stream: str, now_s: float) -> None:
        """Record the time of a valid message."""
        self._heard_s[stream] = now_s

    def refuse(self, stream: str, why: str, now_s: float) -> None:
        """Count a message that was refused, and record the reason."""
        self.refused[stream] = self.refused.get(stream, 0) + 1
        self.trouble(stream, why, now_s)

    def lose(self, stream: str, count: int, now_s: float) -> None:
        """Count messages that were lost on their way, as reported by the middleware."""
        self.lost[stream] = self.lost.get(stream, 0) + count
        self.trouble(stream, f"{count} messages lost in transport", now_s)

    def trouble(self, stream: str, what: str, now_s: float) -> None:
        """Record a problem of a stream, to be reported for `RECENT_S`."""
        self._troubles[stream] = (now_s, what)

    def took(self, duration_s: float, stamp_ns: int, now_s: float) -> None:
        """Record the processing time of a command [s]; one above its period is an overload."""
        last, self._last_stamp = self._last_stamp, stamp_ns
        self.slowest_s = max(self.slowest_s, duration_s)
        if last is None or not 0 < stamp_ns - last < PAUSE_NS:
            return
        period_s = (stamp_ns - last) * 1e-9
        if duration_s > period_s:
            self.late += 1
            each = f"took {duration_s * 1e3:.0f} ms, commands come every {period_s * 1e3:.0f} ms"
            self.trouble("overload", each, now_s)

    def recent(self, now_s: float) -> list[str]:
        """Problems of the last `RECENT_S`, as sentences."""
        return [
            f"{stream}: {what}"
            for stream, (when, what) in self._troubles.items()
            if now_s - when <= RECENT_S
        ]

    def silent_s(self, stream: str, since_s: float, now_s: float) -> float:
        """Time without a message of a stream [s], counted from `since_s` at the earliest."""
        return now_s - max(self._heard_s.get(stream, since_s), since_s)
