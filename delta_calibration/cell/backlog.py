"""Commands that waited while the process stood still: the newest is sent, not the stale ones.

Commands of a stream come as they are stamped. After a stop of the process those that waited come
later than they usually do and faster than they are stamped, all at once, or on a busy machine as
fast as they can be taken; and what the queue could not hold is gone. To send them all would drive
the robot through a past that is over; only the last of such a burst goes on. After a pause of who
commands the first one comes no later than usual, and nothing is lost.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Generic, TypeVar

T = TypeVar("T")

STOP_S = 0.1  # [s] without a command, and the process may have stood still
WAIT_S = 0.01  # [s] that a late command after a stop waits for newer ones
_STOP_PERIODS = 3.0  # of the stream: its own rhythm is no stop
_KNOWN = 3  # steps from which on the stream's period is known
_FASTER = 0.5  # a command that comes in less than this part of what the stamps say has waited
_LATE_PERIODS = 3.0  # of the stream, later than usual: so has one that comes as late


class Backlog(Generic[T]):
    """Takes commands as they come, and hands on those that are to be sent.

    Attributes:
        lost: commands that never came, by the stamps of a stream that stood still.
        superseded: commands that waited, and were not sent as newer ones had come.
    """

    def __init__(self) -> None:
        self.lost = self.superseded = 0
        self.waiting: T | None = None
        self.interrupted = False  # whether the command handed on last comes after lost time
        self._steps_s: deque[float] = deque(maxlen=7)
        self._lags_s: deque[float] = deque(maxlen=7)  # from stamp to coming
        self._missing = 0  # commands between the last one and the one that waits
        self._burst = False
        self._last: tuple[int, float] | None = None  # stamp [ns], when it came [s]

    def take(self, command: T, stamp_ns: int, now_s: float) -> tuple[T, ...]:
        """What is to be sent now that a command came, in order: nothing, one, or two."""
        last, self._last = self._last, (stamp_ns, now_s)
        if last is None:
            return (command,)
        stamped_s, came_s = (stamp_ns - last[0]) * 1e-9, now_s - last[1]
        waiting = self.waiting
        if waiting is not None:
            if stamped_s > 0.0 and (came_s < _FASTER * stamped_s or self._late(stamp_ns, now_s)):
                self._supersede(command)
                return ()
            return (*self.release(), command)
        self.interrupted = False
        if self._stood_still(came_s) and self._late(stamp_ns, now_s):
            self._missing = max(round(stamped_s / median(self._steps_s)) - 1, 0)
            self.waiting, self._burst = command, False
            return ()
        if stamped_s > 0.0:
            self._steps_s.append(stamped_s)
            self._lags_s.append(now_s - stamp_ns * 1e-9)
        return (command,)

    def release(self) -> tuple[T, ...]:
        """The command that waits, as nothing newer came for `WAIT_S`."""
        waiting, self.waiting = self.waiting, None
        self.interrupted = self._burst
        return () if waiting is None else (waiting,)

    def forget(self) -> None:
        """Begin anew, as after a pause of unknown length; the counts stay."""
        self.waiting, self._last = None, None
        self.interrupted = self._burst = False
        self._missing = 0
        self._steps_s.clear()
        self._lags_s.clear()

    def trouble(self) -> str:
        """What to tell of the command handed on last, where it comes after lost time."""
        if not self.interrupted:
            return ""
        return f"stood still: {self.lost} commands lost so far, {self.superseded} late not sent"

    def _stood_still(self, came_s: float) -> bool:
        if len(self._steps_s) < _KNOWN or came_s < STOP_S:
            return False
        return came_s > _STOP_PERIODS * median(self._steps_s)

    def _late(self, stamp_ns: int, now_s: float) -> bool:
        """Whether a command comes later behind its stamp than those before the stop did."""
        late_s = now_s - stamp_ns * 1e-9 - median(self._lags_s)
        return late_s > _LATE_PERIODS * median(self._steps_s)

    def _supersede(self, command: T) -> None:
        self.superseded += 1
        self.waiting, self._burst = command, True
        self.lost += self._missing
        self._missing = 0
