"""Live view of a running cell: state of its calibration nodes, and orders to them.

ROS stays outside this process. `ros/cell_watch.py` listens in a child process and writes one line
of JSON per second; another child process, `ros/trigger.py`, gives an order, by the same service
that a cell's operator would call.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from importlib.util import find_spec
from threading import Lock, Thread
from time import monotonic
from typing import Any

from delta_calibration.errors import InputError, MistakeError
from delta_calibration.processes import child_environment

ORDERS: Mapping[str, tuple[str, str]] = {  # order: its title, what to know beforehand
    "start_capture": (
        "Begin a capture",
        "Earlier captured messages are discarded.",
    ),
    "stop_capture": ("End the capture", "The captured messages are kept for a fit."),
    "fit": (
        "Fit the captured messages",
        "The new calibration is loaded; if compensation is on, it changes over to it.",
    ),
    "diagnose": (
        "Fit and look for causes",
        "Takes longer than a fit. The new calibration is loaded; if compensation is on, it "
        "changes over to it.",
    ),
    "enable": ("Switch compensation on", "Commands to the drives are corrected from now on."),
    "disable": ("Switch compensation off", "Commands go to the drives unchanged."),
    "save": ("Save the calibration", "It is written to the file in the node's parameter output."),
}
NO_ROS = "this Python has no rclpy; source a ROS 2 Jazzy setup before delta-cal serve is started"
_SERVICES = {"enable": ("enable", "true"), "disable": ("enable", "false")}
_GROUPS = {  # title: prefix of the names of its values; all others are in the last group
    "Captured": "captured",
    "Commands and guards": "command",
    "Calibration and state": "",
}
_NODE = re.compile(r"(/[A-Za-z_]\w*)+", re.ASCII)
_WAIT_S = 3600  # longest time for an answer, such as that of a diagnosis
_OLD_S = 5.0  # age from which a node's state counts as old
_KEPT = 12  # earlier answers that are kept
_PATIENCE_S = 5.0  # for a child process to end before it is killed


@dataclass(frozen=True)
class Node:
    """Last known state of one calibration node.

    Attributes:
        name: full name.
        level: `ok`, `warn` or `error`.
        message: its activity and its problems.
        robot: name of its robot.
        values: reported values, by their names with units.
        doing: running tasks, a sentence each.
        old: whether it has not been heard for some seconds.
    """

    name: str
    level: str
    message: str
    robot: str
    values: Mapping[str, str]
    doing: tuple[str, ...]
    old: bool

    def groups(self) -> dict[str, dict[str, str]]:
        """The non-empty values, by group."""
        found: dict[str, dict[str, str]] = {title: {} for title in _GROUPS}
        for name, value in self.values.items():
            title = next(t for t, begins in _GROUPS.items() if name.startswith(begins))
            if value:
                found[title][name] = {"True": "yes", "False": "no"}.get(value, value)
        return {title: figures for title, figures in found.items() if figures}


@dataclass(frozen=True)
class Answer:
    """Answer to an order; `state` is `waiting`, `done` or `refused`."""

    when: str
    node: str
    order: str
    state: str
    said: str


class Cell:
    """Watch the cell's nodes until closed."""

    def __init__(self) -> None:
        """Start watching."""
        self._lock = Lock()
        self._heard: dict[str, tuple[float, dict[str, Any]]] = {}
        self._answers: list[Answer] = []
        self._children: set[subprocess.Popen[str]] = set()
        self._closed = False
        self.trouble = "" if find_spec("rclpy") else NO_ROS
        if not self.trouble:
            Thread(target=self._watch, daemon=True).start()

    def nodes(self) -> tuple[Node, ...]:
        """All calibration nodes seen so far, by name."""
        with self._lock:
            heard = sorted(self._heard.items())
        return tuple(_node(name, data, monotonic() - when) for name, (when, data) in heard)

    def answers(self) -> tuple[Answer, ...]:
        """Answers to orders, the newest first."""
        with self._lock:
            return tuple(reversed(self._answers))

    def order(self, node: str, order: str) -> None:
        """Give an order to a node; the answer appears in `answers`.

        Raises:
            InputError: no such order, or no such node.
            MistakeError: the node has not answered the previous order yet.
        """
        if order not in ORDERS:
            raise InputError(f"order {order!r}: is not known; choose from: {', '.join(ORDERS)}")
        with self._lock:
            if node not in self._heard or not _NODE.fullmatch(node):
                raise InputError(f"node {node!r}: was not found on this ROS domain")
            if any(a.node == node and a.state == "waiting" for a in self._answers):
                raise MistakeError(f"{node} has not answered the previous order yet")
            when = datetime.now(timezone.utc).strftime("%H:%M:%S")
            answer = Answer(when, node, order, "waiting", "")
            self._answers = [*self._answers[-_KEPT:], answer]
        Thread(target=self._give, args=(answer,), daemon=True).start()

    def close(self) -> None:
        """End all child processes."""
        with self._lock:
            self._closed = True
            children = list(self._children)
        for child in children:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGINT)
        for child in children:
            try:
                child.wait(_PATIENCE_S)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)

    def _watch(self) -> None:
        child = self._start("cell_watch")
        if child is None or child.stdout is None:
            return
        for line in child.stdout:
            data: dict[str, Any] = json.loads(line)
            with self._lock:
                self._heard[data["node"]] = (monotonic(), data)
        _, errors = child.communicate()
        said = errors.strip().splitlines()
        self.trouble = said[-1] if said else "the connection to the cell is closed"

    def _give(self, answer: Answer) -> None:
        service, *flag = _SERVICES.get(answer.order, (answer.order,))
        child = self._start("trigger", f"{answer.node}/{service}", *flag, str(_WAIT_S))
        if child is None:
            return
        output, errors = child.communicate()
        said = (output.strip() or errors.strip() or "no answer").splitlines()[-1]
        state = "done" if child.returncode == 0 else "refused"
        told = Answer(answer.when, answer.node, answer.order, state, said)
        with self._lock:
            self._children.discard(child)
            self._answers = [told if a is answer else a for a in self._answers]

    def _start(self, module: str, *arguments: str) -> subprocess.Popen[str] | None:
        with self._lock:
            if self._closed:
                return None
            child = subprocess.Popen(
                [sys.executable, "-m", f"delta_calibration.ros.{module}", *arguments],
                env=child_environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            self._children.add(child)
        return child


def _node(name: str, data: Mapping[str, Any], age_s: float) -> Node:
    return Node(
        name=name,
        level=data["level"],
        message=data["message"],
        robot=data["robot"],
        values=data["values"],
        doing=tuple(data["doing"]),
        old=age_s > _OLD_S,
    )
