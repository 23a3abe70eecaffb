"""Settings of a node's own process: memory, garbage collection, priority, and their report."""

from __future__ import annotations

import gc
import subprocess
import sys

import pytest

from delta_calibration.ros.own_process import OwnProcess

SCRIPT = """
import gc, os, resource, sys, threading
from pathlib import Path
from delta_calibration.ros.own_process import OwnProcess

def locked():
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except PermissionError:  # of another user by now
        return 0
    return int(next(l for l in lines if l.startswith("VmLck")).split()[1])

other = threading.Event()
thread = threading.Thread(target=other.wait, daemon=True)
thread.start()
{before}
own = OwnProcess(True)
own.hold({priority})
later = threading.Thread(target=lambda: print("later", os.sched_getscheduler(0)))
later.start()
later.join()
own.tidy()
print("values", own.values)
print("held", gc.isenabled(), gc.get_freeze_count() > 0, locked() > 0)
print("scheduler", os.sched_getscheduler(0) & 3, os.sched_getscheduler(thread.native_id) & 3)
own.release()
print("released", gc.isenabled(), gc.get_freeze_count(), locked(), os.sched_getscheduler(0))
other.set()
"""


def said(priority: int, before: str = "") -> dict[str, str]:
    """Output of a separate process, by the first word of each line."""
    script = SCRIPT.format(priority=priority, before=before)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    return dict(line.split(" ", 1) for line in done.stdout.splitlines())


def allowed() -> bool:
    """Whether this user may lock memory and set a real-time priority."""
    script = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    return done.returncode == 0


def test_a_shared_process_is_left_alone() -> None:
    own = OwnProcess(False)
    own.hold(50)
    own.tidy()
    assert gc.isenabled()
    assert own.values == {"memory": "as of any program", "priority": "as of any program"}
    own.release()


@pytest.mark.skipif(not allowed(), reason="a user who may not lock memory or take a priority")
def test_memory_is_locked_garbage_waits_and_all_threads_go_first() -> None:
    told = said(7)
    assert told["values"] == "{'memory': 'locked', 'priority': 'FIFO 7'}"
    assert told["held"] == "False True True"
    assert told["scheduler"] == "1 1"  # SCHED_FIFO for threads that ran before
    assert told["later"] == "0"  # a normal one
    assert told["released"] == "True 0 0 0"


def test_what_the_system_refuses_is_told_and_the_process_goes_on() -> None:
    without = (
        "resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))\n"
        "resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))\n"
        "if os.getuid() == 0: os.setgid(65534); os.setuid(65534)"
    )
    told = said(7, without)
    assert "not locked: ulimit -l allows 64 kB" in told["values"]
    assert "refused: Operation not permitted; ulimit -r 7, or CAP_SYS_NICE" in told["values"]
    assert told["held"] == "False True False"
    assert told["scheduler"] == "0 0"
    assert told["released"] == "True 0 0 0"
