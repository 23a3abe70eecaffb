"""Real-time settings of a process on the command path, to avoid delays of commands.

Its memory is locked in RAM once touched; Python's garbage collector runs only between commands;
and on request, its threads get a real-time priority. A setting that the system refuses is
reported, and the process continues without it.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource
from collections.abc import Iterator, Mapping
from pathlib import Path

_CURRENT, _FUTURE, _ONFAULT = 1, 2, 4  # of mlockall, in <sys/mman.h>
_LOCK_ANY = 14  # CAP_IPC_LOCK
_TASKS, _STATUS = Path("/proc/self/task"), Path("/proc/self/status")


def lock_memory() -> str:
    """Lock memory in RAM when it is touched; return why that was refused, else an empty text.

    Not attempted with a limited RLIMIT_MEMLOCK: later allocations beyond it would fail.
    """
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if limit != resource.RLIM_INFINITY and not _capable(_LOCK_ANY):
        return f"ulimit -l allows {limit // 1024} kB; unlimited is needed"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_CURRENT | _FUTURE | _ONFAULT) != 0:
        return os.strerror(ctypes.get_errno())
    return ""


def take_priority(priority: int) -> str:
    """Give all present threads a SCHED_FIFO priority; return why that was refused, else empty.

    Threads and processes started later have the ordinary priority again, so that a fit waits.

    Args:
        priority: 1 to 99; 0 for the ordinary priority (SCHED_OTHER).
    """
    policy = (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK) if priority else os.SCHED_OTHER
    try:
        for thread in _threads():
            os.sched_setscheduler(thread, policy, os.sched_param(priority))
    except OSError as error:
        return f"{error.strerror}; ulimit -r {priority}, or CAP_SYS_NICE, is needed"
    return ""


class OwnProcess:
    """Applies the real-time settings, but only if the process contains no other node.

    Attributes:
        refused: reason why a requested priority was refused; else empty.

    Args:
        alone: whether the node has its own process.
    """

    def __init__(self, alone: bool) -> None:
        self._alone, self._held = alone, False
        self.refused = ""
        self._memory = self._priority = "as of any program"

    def hold(self, priority: int) -> None:
        """Lock memory, stop automatic garbage collection, and take a priority if above 0."""
        if not self._alone:
            return
        self._held = True
        gc.collect()
        gc.freeze()
        gc.disable()
        unlocked = lock_memory()
        self._memory = f"not locked: {unlocked}" if unlocked else "locked"
        self.refused = take_priority(priority) if priority else ""
        if priority:
            self._priority = f"refused: {self.refused}" if self.refused else f"FIFO {priority}"

    def tidy(self) -> None:
        """Collect garbage, which is brief; to be called between commands."""
        if self._held:
            gc.collect()

    def release(self) -> None:
        """Restore the ordinary settings of the process."""
        if not self._held:
            return
        self._held, self.refused = False, ""
        gc.unfreeze()
        gc.enable()
        ctypes.CDLL(None).munlockall()
        take_priority(0)
        self._memory = self._priority = "as of any program"

    @property
    def values(self) -> Mapping[str, object]:
        """Values for diagnostics."""
        return {"memory": self._memory, "priority": self._priority}


def _threads() -> Iterator[int]:
    """Ids of the threads of this process."""
    return (int(task.name) for task in _TASKS.iterdir())


def _capable(capability: int) -> bool:
    """Whether this process has a Linux capability."""
    try:
        lines = _STATUS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return False
    for line in lines:
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> capability & 1)
    return False
