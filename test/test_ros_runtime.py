"""Start, spin, stop and exit code of real nodes in their own processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
from delta_calibration.processes import child_environment, remove_dead_shared_memory
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.runtime import StopSignals
from delta_calibration.ros.watchdog import REPEAT_S
from ros_helpers import Bench, Launch, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros

CELL = '''
import re, sys, threading, time
from pathlib import Path
from delta_calibration.errors import DataError
from delta_calibration.ros.lifecycle import SafeLifecycleNode
from delta_calibration.ros.runtime import BaseNode, run
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

WHAT = sys.argv[1]

class Busy(BaseNode):
    """Works in slices of 20 ms that must never be cut in half; does at 0.3 s what it is told."""

    def __init__(self):
        super().__init__("busy")
        self.begun = self.ended = 0
        self.create_service(Trigger, "~/own", lambda _, answer: answer)
        self.create_timer(0.025, self.work)
        if WHAT not in ("work", "without_events"):
            self.create_timer(0.3, getattr(self, WHAT))
        self.get_logger().info("ready")

    def work(self):
        self.begun += 1
        for _ in range(20):
            time.sleep(0.001)
        self.ended += 1

    def end(self): self.finish(7)
    def refuse(self): self.fail(DataError("nothing was still"))
    def crash(self): raise ValueError("a bug")
    def order(self):  # as a peer does by `ros2 param set`
        (done,) = self.set_parameters([Parameter("use_sim_time", value=False)])
        offered = [s.service_name for s in self.services if s.service_name.startswith("/busy/own")]
        self.get_logger().info(f"ordered: {done.successful}, {done.reason!r}, {offered}")
        self.finish()

    def full(self): raise OSError(28, "No space left on device", "/session")

    def hang(self):
        self.get_logger().info("hangs")
        time.sleep(1000.0)

    def hold(self):
        self.get_logger().info("hangs")

    def worker(self):  # which python itself waits for, when all else is done
        threading.Thread(target=time.sleep, args=(1000.0,)).start()
        self.get_logger().info("hangs")

    def close(self):
        if WHAT == "hold":  # in compiled code that keeps python's lock
            time.sleep(0.2)
            re.match("(a+)+$", 60 * "a" + "b")
        self.get_logger().info(f"closed, whole: {self.begun == self.ended}, {self.context.ok()}")

class Managed(SafeLifecycleNode):
    def deactivate(self):
        self.get_logger().info("deactivated")
    def activate(self):
        self.get_logger().info("activated")

if sys.argv[1] == "without_events":  # as in an rclpy that has no events executor
    sys.modules["rclpy.experimental.events_executor"] = None
class Hanging(Busy):
    stop_limit_s = 0.5 if sys.argv[2:] == ["short"] else 60.0

HANGING = dict.fromkeys(("hang", "hold", "worker"), Hanging)
build = {"managed": lambda: Managed("managed"), **HANGING}.get(sys.argv[1], Busy)
if build is Hanging:
    del sys.argv[1:]
    raise SystemExit(run(build, "cell"))
raise SystemExit(run(build, "cell", [sys.argv[0], *sys.argv[2:]]))
'''


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of a module with the nodes above, which child processes can import."""
    (tmp_path / "cell_under_test.py").write_text(CELL)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "cell_under_test"


@pytest.mark.parametrize(
    ("services", "said"),
    [
        (True, "ordered: True, '', ['/busy/own']"),
        (False, "ordered: False, 'services are off (services:=false)', []"),
    ],
)
def test_any_node_may_be_shut_to_its_peers(
    launch: Launch, cell: str, services: bool, said: str
) -> None:
    node = launch(cell, "order", services=services)
    assert node.end() == 0
    assert said in node.output


@pytest.mark.parametrize(
    ("what", "number"),
    [("work", signal.SIGINT), ("work", signal.SIGTERM), ("without_events", signal.SIGINT)],
)
def test_a_signal_ends_the_node_after_its_callback_with_0(
    launch: Launch, cell: str, what: str, number: signal.Signals
) -> None:
    node = launch(cell, what)
    assert node.says("ready")
    time.sleep(0.2)
    node.send(number)
    node.send(number)  # as if from a terminal and from a launcher
    assert node.end() == 0
    assert "closed, whole: True, True" in node.output
    assert "Traceback" not in node.output


@pytest.mark.parametrize(
    ("what", "number", "said"),
    [
        (
            "hang",
            signal.SIGINT,
            "cell: not ended 0.5 s after SIGINT (its main thread is in hang, cell_",
        ),
        (
            "hang",
            signal.SIGTERM,
            "cell: not ended 0.5 s after SIGTERM (its main thread is in hang, cell_",
        ),
        ("worker", signal.SIGINT, "cell: not ended 0.5 s after SIGINT (its main thread is in "),
        ("hold", signal.SIGINT, "in close\n"),  # from faulthandler, which needs no Python
    ],
)
def test_what_hangs_when_it_is_told_to_stop_is_ended_with_1(
    launch: Launch, cell: str, what: str, number: signal.Signals, said: str
) -> None:
    node = launch(cell, what, "short")
    assert node.says("hangs")
    node.send(number)
    assert node.end() == 1
    assert said in node.output
    assert ("exit status 1\n" in node.output) == (what != "hold")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_ends_a_node_that_hangs_at_once(
    launch: Launch, cell: str, number: signal.Signals
) -> None:
    node = launch(cell, "hang")  # otherwise it would have a minute
    assert node.says("hangs")
    node.send(signal.SIGINT)
    node.send(signal.SIGINT)  # twice, as from a terminal and from a launcher
    time.sleep(REPEAT_S + 0.1)
    assert node.process.poll() is None
    node.send(number)
    assert node.end() == 128 + number
    assert f"cell: {number.name} again: ended at once" in node.output
    assert f"exit status {128 + number}\n" in node.output


def test_a_watchdog_that_is_closed_leaves_signals_as_they_were() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with StopSignals("cell", to_the_end=False) as stop:
        stop.spinning = True
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.requested
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    assert signal.set_wakeup_fd(-1) == -1
    assert "watchdog" not in {thread.name for thread in threading.enumerate()}


def test_a_node_at_rest_uses_no_processor(launch: Launch, cell: str) -> None:
    node = launch(cell, "managed", autostart=True)
    assert node.says("activated")
    before = cpu_seconds(node.process.pid)
    time.sleep(1.0)
    assert cpu_seconds(node.process.pid) - before < 0.3
    node.send(signal.SIGINT)
    assert node.end() == 0
    assert "deactivated" in node.output


@pytest.mark.parametrize(
    ("what", "code", "said"),
    [
        ("end", 7, "closed"),
        ("refuse", 1, "nothing was still"),
        ("crash", 1, "ValueError: a bug"),
        ("full", 1, "No space left on device"),
    ],
)
def test_a_node_ends_with_its_own_exit_code(
    launch: Launch, cell: str, what: str, code: int, said: str
) -> None:
    node = launch(cell, what)
    assert node.end() == code
    assert said in node.output
    assert "closed, whole: True, True" in node.output
    assert ("Traceback" in node.output) == (what == "crash")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--verbose"], "unknown argument '--verbose'"),
        (["--ros-args", "-p", "output"], "ROS arguments"),
        (["--ros-args", "--no-such-thing"], "ROS arguments"),
        ([], "parameter output: is empty"),
        (["--ros-args", "-p", "output:=3"], "parameter output: 3 is not of type str"),
        (["--ros-args", "-p", "output:=/x", "-p", "topics:=[joint_comand]"], "joint_comand"),
        (["--ros-args", "-p", "output:=/x", "-p", "provenance:=[seed]"], "key=value"),
    ],
)
def test_wrong_use_is_one_line_and_2(launch: Launch, arguments: list[str], said: str) -> None:
    node = launch("delta_calibration.ros.session_recorder", *arguments)
    assert node.end() == 2
    assert said in node.output
    assert len(node.output.strip().splitlines()) == 1


def test_without_rclpy_the_executable_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert run_node("session_recorder") == 2
    assert "rclpy is not installed" in capsys.readouterr().err


def test_a_child_gets_neither_the_mark_nor_the_libraries_of_the_wheels() -> None:
    inherited = {
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
        "LD_LIBRARY_PATH": "/opt/vendor/lib:/env/lib/python3.11/site-packages/ros_rcl.libs",
        "HOME": "/home/cell",
    }
    child = child_environment(domain_id=7, base=inherited, local_only=True)
    assert child == {
        "LD_LIBRARY_PATH": "/opt/vendor/lib",
        "HOME": "/home/cell",
        "ROS_DOMAIN_ID": "7",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    apt = {"LD_LIBRARY_PATH": "/opt/ros/jazzy/lib"}
    assert child_environment(base=apt) == apt


def test_only_the_dead_lose_their_shared_memory(tmp_path: Path) -> None:
    names = ("fastrtps_dead", "fastrtps_dead_el", "sem.fastrtps_dead_mutex", "fastrtps_alive")
    for name in (*names, "fastrtps_alive_el", "fastrtps_new", "fastrtps_old", "other"):
        (tmp_path / name).touch()
    os.utime(tmp_path / "fastrtps_old", (0.0, 0.0))
    holder = subprocess.Popen(
        ["flock", str(tmp_path / "fastrtps_alive_el"), "sleep", "30"], start_new_session=True
    )
    try:
        time.sleep(0.3)
        assert remove_dead_shared_memory(tmp_path) == ["fastrtps_dead", "fastrtps_old"]
    finally:
        os.killpg(holder.pid, signal.SIGKILL)
        holder.wait()
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["fastrtps_alive", "fastrtps_alive_el", "fastrtps_new", "other"]


def cpu_seconds(pid: int) -> float:
    """Processor time that a process has used so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_a_bench_that_is_taken_down_leaves_no_participant_to_the_next() -> None:
    """With more than 32 participants in a process, other ones are no longer discovered."""
    bench = Bench()
    context, node = weakref.ref(bench.context), bench.node("self_referring")
    node.itself = node.get_name  # like callbacks bound to their node
    bench.take_down()
    del bench, node
    Bench().take_down()
    assert context() is None


def test_what_is_left_of_a_process_takes_nothing_apart_once_more() -> None:
    """Threads finish and output is flushed, but exit handlers of libraries do not run."""
    script = """
import atexit, sys, threading, time
from delta_calibration.ros.watchdog import leave

def work():
    time.sleep(0.3)
    print("kept")

atexit.register(print, "taken apart")
threading.Thread(target=work).start()
leave(3)
"""
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (3, "kept\n", "")
