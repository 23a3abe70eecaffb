"""Watchdog that ends a process in a bounded time after a stop signal, whatever hangs.

A thread receives the signals through a pipe that is written below Python, so a hanging callback
does not block it. If compiled code then takes Python's lock and never releases it (a destructor
that waits for a thread), `faulthandler`, which needs no Python, prints the stack of every thread
and ends the process. Both stay armed after `main()` has returned, as Python waits for threads at
its end. Not covered is compiled code that already holds the lock when the signal arrives: the
launcher of the node has to kill it.
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
KILLED = 128  # added to the number of the signal, as in shells


class Watchdog:
    """Watches for SIGINT and SIGTERM from its construction on; only for the main thread.

    After the first signal the process has `limit_s` to end, else it exits with HUNG. A second
    signal, later than REPEAT_S, ends it at once with KILLED plus the signal's number. Either exit
    prints a line on stderr.

    Args:
        name: name of the node, for that line.
        to_the_end: whether `close` leaves the time limit running after a signal: for a process
            that only has to end.
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
        """Stop watching, except after a signal with `to_the_end`; return whether it stopped."""
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
        """Number of the next stop signal; None if the time is over or the pipe closed."""
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
    """End a process whose work is done and whose node is closed, after its running threads.

    Skips Python's own shutdown: there the middleware is destroyed once more, and on a busy
    computer it may wait for a thread that no longer exists.
    """
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or nobody reads it any more
            stream.flush()
    os._exit(status)


def _place(thread: int) -> str:
    """Describe the present code location of a thread of this process."""
    frame = sys._current_frames().get(thread)
    if frame is None:
        return "its main thread has ended"
    last = traceback.extract_stack(frame)[-1]
    return f"its main thread is in {last.name}, {os.path.basename(last.filename)}:{last.lineno}"
