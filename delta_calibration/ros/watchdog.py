"""Ends a process that was told to stop and does not: in a bounded time, whatever hangs.

A thread looks at the signals as they arrive, through a pipe that is written below python: a
callback that hangs does not hold it up. Should compiled code take python's lock after that and
never give it back (a destructor that waits for a thread), then `faulthandler`, which needs no
python, writes where every thread stands and ends the process. Both stay armed when `main()` has
returned, as python waits for threads at its end. Out of reach is compiled code that keeps the lock
already when the signal comes: whoever launched the node has to kill it.
"""

from __future__ import annotations

import faulthandler
import os
import select
import signal
import sys
import threading
import time
import traceback
from contextlib import suppress
from typing import NoReturn

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
REPEAT_S = 1.0  # [s] a terminal and a launcher often send the same signal twice
LIMIT_S = 4.0  # [s] to end in; launch sends SIGTERM 5 s after SIGINT
GRACE_S = 0.5  # [s] more, if not even a python thread can run
HUNG = 1
KILLED = 128  # beside the number of the signal, as shells count


class Watchdog:
    """Watches for SIGINT and SIGTERM from its making on; only for the main thread.

    The first signal allows `limit_s` until the end of the process, which then leaves with HUNG; a
    second one, later than REPEAT_S, ends it at once with KILLED and the signal's number. Each is
    said in a line on stderr.

    Args:
        name: of the node, for that line.
        to_the_end: once a signal has come, whether `close` leaves the time running: for a process
            that has nothing to do but to end.
    """

    def __init__(self, name: str, to_the_end: bool) -> None:
        self.limit_s = LIMIT_S
        self._name, self._to_the_end = name, to_the_end
        self._read, self._write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._previous = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        self._main = threading.get_ident()
        self._signalled = self._closed = False
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._thread.start()

    def close(self) -> bool:
        """Watch no more, unless a signal came and the process is to end; whether it is over."""
        if self._signalled and self._to_the_end:
            return False
        self._closed = True
        signal.set_wakeup_fd(self._previous)
        os.close(self._write)
        self._thread.join()
        os.close(self._read)
        if self._signalled:
            faulthandler.cancel_dump_traceback_later()
        return True

    def _watch(self) -> None:
        first = self._next(None)
        if first is None:
            return
        self._signalled, begun = True, time.monotonic()
        faulthandler.dump_traceback_later(self.limit_s + GRACE_S, exit=True, file=2)
        while (left := begun + self.limit_s - time.monotonic()) > 0.0:
            again = self._next(left)
            if self._closed:
                return
            if again is not None and time.monotonic() - begun >= REPEAT_S:
                self._end(KILLED + again, f"{signal.Signals(again).name} again: ended at once")
        self._end(HUNG, f"not ended {self.limit_s:g} s after {signal.Signals(first).name}")

    def _next(self, timeout_s: float | None) -> int | None:
        """Number of the next signal to stop; None where the time is over, or the pipe closed."""
        while select.select([self._read], [], [], timeout_s)[0]:
            numbers = os.read(self._read, 1)
            if not numbers:
                return None
            if numbers[0] in STOP_SIGNALS:
                return numbers[0]
        return None

    def _end(self, status: int, why: str) -> None:
        line = f"{self._name}: {why} ({_place(self._main)}); exit status {status}\n"
        os.write(2, line.encode(errors="replace"))  # the log may be what hangs
        os._exit(status)


def leave(status: int) -> NoReturn:
    """End a process whose work is done and whose node is closed; waits for threads that work.

    Without python's own end: there the middleware takes itself apart once more, and on a busy
    machine may wait for a thread that is gone.
    """
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or nobody reads it any more
            stream.flush()
    os._exit(status)


def _place(thread: int) -> str:
    """Where a thread of this process stands, in a few words."""
    frame = sys._current_frames().get(thread)
    if frame is None:
        return "its main thread is gone"
    last = traceback.extract_stack(frame)[-1]
    return f"it stands in {last.name}, {os.path.basename(last.filename)}:{last.lineno}"
