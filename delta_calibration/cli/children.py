"""Run nodes as child processes of a verb; they all end with it, however it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from threading import Lock
from types import FrameType

from delta_calibration.errors import CalibrationError
from delta_calibration.processes import child_environment

_NODES = "delta_calibration.ros"
_PATIENCE = 8.0  # [s] for a node to end before the next, stronger signal


class Children:
    """Starts and monitors nodes of this package; a context manager.

    Each child is the leader of a session of its own: Ctrl-C in a terminal reaches this process
    only, and this process ends the children in order.
    """

    def __init__(self, domain_id: int, logs: Path) -> None:
        """Prepare children on one ROS domain of this machine; they write to the folder `logs`."""
        self._environment = child_environment(domain_id, local_only=True)
        self._logs = logs
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._starting = Lock()  # a thread may start a child while this one stops them all
        self._stopped = False

    def __enter__(self) -> Children:
        # Needed too if a shell started this process in the background with Ctrl-C ignored.
        self._before = {s: signal.signal(s, _interrupt) for s in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:
        with _no_interrupts():
            self.stop()
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def start(
        self, node: str, parameters: Mapping[str, object], remaps: Mapping[str, str] | None = None
    ) -> None:
        """Start a node that runs until `stop`."""
        self._start(node, node, _ros_arguments(parameters, remaps or {}), node)

    def run(
        self, node: str, arguments: Sequence[str], timeout: float, log: str | None = None
    ) -> str:
        """Run a node to its end and return its standard output.

        Raises:
            CalibrationError: it failed or took too long, or a node that should be running has
            ended.
        """
        child = self._start(f"{node} (to its end)", node, arguments, log or node, capture=True)
        deadline = time.monotonic() + timeout
        while child.poll() is None:
            self._require_running(except_=child)
            if time.monotonic() > deadline:
                raise CalibrationError(
                    f"{node} did not end within {timeout:.0f} s; see {self._logs}"
                )
            time.sleep(0.05)
        self._running.pop(f"{node} (to its end)", None)
        output = (child.communicate()[0] or b"").decode()
        if child.returncode != 0:
            logged = (self._logs / f"{log or node}.log").read_text("utf-8", "replace")
            said = (output or logged).strip().splitlines() or ["it printed nothing"]
            raise CalibrationError(f"{node} ended with {child.returncode}: {said[-1]}")
        return output.strip()

    def plan(self, parameters: Mapping[str, object], timeout: float) -> None:
        """Run a measurement plan to its end."""
        self.run("measurement_plan", _ros_arguments(parameters, {}), timeout)

    def call(self, service: str, value: bool | None = None, timeout: float = 60.0) -> str:
        """Call a service and return the message of its answer."""
        arguments = [service, *([] if value is None else [str(value).lower()]), str(timeout)]
        return self.run("trigger", arguments, timeout + 10.0)

    def stop(self) -> None:
        """End every child by SIGINT, then SIGTERM, then SIGKILL; no other starts after that."""
        with self._starting:
            self._stopped = True
        for order in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for child in list(self._running.values()):
                if child.poll() is None:
                    with contextlib.suppress(ProcessLookupError):
                        os.killpg(child.pid, order)
            if self._wait(_PATIENCE):
                break
        self._running.clear()

    def _wait(self, seconds: float) -> bool:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if all(child.poll() is not None for child in list(self._running.values())):
                return True
            time.sleep(0.02)
        return False

    def _require_running(self, except_: subprocess.Popen[bytes]) -> None:
        for name, child in list(self._running.items()):
            if child is not except_ and child.poll() is not None:
                raise CalibrationError(
                    f"{name} ended by itself with {child.returncode}; see {self._logs}"
                )

    def _start(
        self, name: str, node: str, arguments: Sequence[str], log: str, capture: bool = False
    ) -> subprocess.Popen[bytes]:
        """Start a child that is known as `name` from then on.

        Raises:
            CalibrationError: all have been stopped.
        """
        self._logs.mkdir(parents=True, exist_ok=True)
        with self._starting, (self._logs / f"{log}.log").open("ab") as file:
            if self._stopped:
                raise CalibrationError(f"{node} was not started: all nodes have been stopped")
            self._running[name] = child = subprocess.Popen(
                [sys.executable, "-m", f"{_NODES}.{node}", *arguments],
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if capture else file,
                stderr=file,
                start_new_session=True,
            )
        return child


def _ros_arguments(parameters: Mapping[str, object], remaps: Mapping[str, str]) -> list[str]:
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{name}:={text}"]
    for name, value in remaps.items():
        arguments += ["-r", f"{name}:={value}"]
    return arguments


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@contextlib.contextmanager
def _no_interrupts() -> Iterator[None]:
    """Ignore SIGINT and SIGTERM, so that a second Ctrl-C leaves no children behind."""
    before = {s: signal.signal(s, signal.SIG_IGN) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
