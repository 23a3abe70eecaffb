"""What a process of the command path does for itself, so that commands need not wait.

Its memory stays in RAM once it has been touched; Python's garbage collector runs between commands
and never in one; and, where that is asked for, its threads go before those of ordinary programs.
What the system does not allow is told, and the process goes on without it.
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
    """Keep in RAM what is touched from now on; why not, where the system refuses; else empty.

    Not attempted below a limit: memory that is asked for beyond it would be refused later.
    """
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if limit != resource.RLIM_INFINITY and not _capable(_LOCK_ANY):
        return f"ulimit -l allows {limit // 1024} kB; unlimited is needed"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_CURRENT | _FUTURE | _ONFAULT) != 0:
        return os.strerror(ctypes.get_errno())
    return ""


def take_priority(priority: int) -> str:
    """Let all threads that run now go first (SCHED_FIFO); why not, or empty.

    Threads and processes that are started later are ordinary ones again: a fit waits.

    Args:
        priority: 1 to 99; 0 for that of ordinary programs.
    """
    policy = (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK) if priority else os.SCHED_OTHER
    try:
        for thread in _threads():
            os.sched_setscheduler(thread, policy, os.sched_param(priority))
    except OSError as error:
        return f"{error.strerror}; ulimit -r {priority}, or CAP_SYS_NICE, is needed"
    return ""


class OwnProcess:
    """The process of a node whose commands need not wait; nothing of it where there are others.

    Attributes:
        refused: why there is no priority though one was asked for; else empty.

    Args:
        alone: whether the process is the node's own.
    """

    def __init__(self, alone: bool) -> None:
        self._alone, self._held = alone, False
        self.refused = ""
        self._memory = self._priority = "as of any program"

    def hold(self, priority: int) -> None:
        """Lock memory, keep garbage from being collected in a command, take a priority."""
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
        """Collect what has become garbage: brief, to be called between commands."""
        if self._held:
            gc.collect()

    def release(self) -> None:
        """A process as any other again."""
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
        """What is to be told of it."""
        return {"memory": self._memory, "priority": self._priority}


def _threads() -> Iterator[int]:
    """Threads of this process."""
    return (int(task.name) for task in _TASKS.iterdir())


def _capable(capability: int) -> bool:
    """Whether this process has a capability of Linux."""
    try:
        lines = _STATUS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return False
    for line in lines:
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> capability & 1)
    return False
