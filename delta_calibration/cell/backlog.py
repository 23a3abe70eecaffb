"""Filter for commands that queued up while the process was interrupted: only the newest is sent.

Commands of a stream normally arrive at the intervals of their stamps. After a stop of the process
the queued commands arrive later than usual and faster than their stamps say: all at once or, on a
busy computer, as fast as they can be taken. Commands that the queue could not hold are lost. To
send the whole burst would drive the robot along an outdated path, so only its last command is
sent. After a pause of the sender, the first command arrives with the usual delay; none is lost.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Generic, TypeVar

T = TypeVar("T")

STOP_S = 0.1  # [s] without a command, after which the process may have been stopped
WAIT_S = 0.01  # [s] that a late command after a stop waits for newer ones
_STOP_PERIODS = 3.0  # periods of the stream; a shorter gap is no stop
_KNOWN = 3  # intervals from which on the period of the stream is known
_FASTER = 0.5  # arrival interval / stamp interval below which a command was queued
_LATE_PERIODS = 3.0  # periods of delay beyond the usual one, above which a command was queued


class Backlog(Generic[T]):
    """Takes commands as they arrive, and returns those that are to be sent.

    Attributes:
        lost: number of commands that never arrived, by the gaps between stamps after a stop.
        superseded: number of queued commands not sent, because newer ones had arrived.
    """

    def __init__(self) -> None:
        self.lost = self.superseded = 0
        self.waiting: T | None = None
        self.interrupted = False  # whether the last command returned follows an interruption
        self._steps_s: deque[float] = deque(maxlen=7)
        self._lags_s: deque[float] = deque(maxlen=7)  # from stamp to arrival
        self._missing = 0  # commands missing between the last one and the waiting one
        self._burst = False
        self._last: tuple[int, float] | None = None  # stamp [ns], arrival time [s]

    def take(self, command: T, stamp_ns: int, now_s: float) -> tuple[T, ...]:
        """Take a command that arrived; return the commands to send now, none to two, in order."""
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
        """Return the waiting command; to be called if no newer one arrived within `WAIT_S`."""
        waiting, self.waiting = self.waiting, None
        self.interrupted = self._burst
        return () if waiting is None else (waiting,)

    def forget(self) -> None:
        """Reset the state after a pause of unknown length, but keep the counts."""
        self.waiting, self._last = None, None
        self.interrupted = self._burst = False
        self._missing = 0
        self._steps_s.clear()
        self._lags_s.clear()

    def trouble(self) -> str:
        """Warning about the last command returned; empty if no interruption came before it."""
        if not self.interrupted:
            return ""
        return (
            f"the process was interrupted: {self.lost} commands lost so far, {self.superseded} "
            "late ones not sent"
        )

    def _stood_still(self, came_s: float) -> bool:
        if len(self._steps_s) < _KNOWN or came_s < STOP_S:
            return False
        return came_s > _STOP_PERIODS * median(self._steps_s)

    def _late(self, stamp_ns: int, now_s: float) -> bool:
        """Whether the delay from stamp to arrival is longer than before the stop."""
        late_s = now_s - stamp_ns * 1e-9 - median(self._lags_s)
        return late_s > _LATE_PERIODS * median(self._steps_s)

    def _supersede(self, command: T) -> None:
        self.superseded += 1
        self.waiting, self._burst = command, True
        self.lost += self._missing
        self._missing = 0
