"""Real nodes for tests: in this process, and as separate processes."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
import warnings
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from delta_calibration.processes import child_environment, remove_dead_shared_memory
from delta_calibration.ros.inventory import NODES

with (
    warnings.catch_warnings()
):  # the first message made imports lark, which imports a deprecated module
    warnings.simplefilter("ignore", DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

PATIENCE_S = 40.0
ROOT = Path(__file__).parents[1]


_CONTEXTS: weakref.WeakSet[Context] = weakref.WeakSet()  # of all benches


def _collect() -> None:
    """Release the participants of benches that were taken down.

    Nodes refer to themselves, and a context with its participant exists as long as its nodes do,
    until they are collected. With more than 32 participants in a process, further ones are not
    discovered any more.
    """
    gc.collect()
    if _CONTEXTS:  # something referred to them when the rest was frozen
        gc.unfreeze()
        gc.collect()
    gc.freeze()  # what exists now is skipped the next time, which saves time


class Bench:
    """Nodes of one test on their own context, spun while something is awaited."""

    def __init__(self) -> None:
        _collect()
        self.context = Context()
        _CONTEXTS.add(self.context)
        self.context.init(args=[])
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []

    def add(self, node: Node) -> Node:
        """Let the executor spin this node, and destroy it at the end."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def node(self, name: str, **kwargs: object) -> Node:
        return self.add(Node(name, context=self.context, **kwargs))

    def until(self, condition: Callable[[], object], timeout_s: float = PATIENCE_S) -> bool:
        """Spin until the condition holds; return whether it does."""
        end = time.monotonic() + timeout_s
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.executor.spin_once(timeout_sec=min(left, 0.02))
        return True

    def spin_for(self, seconds: float) -> None:
        self.until(lambda: False, seconds)

    def take_down(self) -> None:
        for node in self.nodes:
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()


@pytest.fixture(name="bench")
def bench_fixture() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.take_down()


def environment() -> dict[str, str]:
    """Environment of a node under test: that of the tests, with the package's sources."""
    variables = child_environment()
    sources = [str(ROOT), *variables.get("PYTHONPATH", "").split(os.pathsep)]
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, sources))
    return variables


class NodeProcess:
    """A node in a separate process; its output goes to a file."""

    def __init__(self, command: list[str], log: Path) -> None:
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, *command],
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment(),
            )

    @property
    def output(self) -> str:
        return self.log.read_text(errors="replace")

    def says(self, text: str, timeout_s: float = PATIENCE_S) -> bool:
        """Wait until its output contains the text; return whether it does."""
        end = time.monotonic() + timeout_s
        while text not in self.output:
            if time.monotonic() > end or self.process.poll() is not None:
                return text in self.output
            time.sleep(0.02)
        return True

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def end(self, timeout_s: float = PATIENCE_S) -> int:
        """Wait for it to end by itself; return its exit code."""
        return self.process.wait(timeout_s)


Launch = Callable[..., NodeProcess]


@pytest.fixture(name="launch")
def launch_fixture(tmp_path: Path) -> Iterator[Launch]:
    """Start `python -m module --ros-args -p name:=value ...`; killed at the end if still running.

    Executables of the package are started by their entry point, like the console scripts.
    """
    started: list[NodeProcess] = []

    def start(module: str, *arguments: str, **parameters: object) -> NodeProcess:
        options = [o for k, v in parameters.items() for o in ("-p", f"{k}:={yaml(v)}")]
        ros = ["--ros-args", *options] if options else []
        place, _, name = module.rpartition(".")
        entered = name in NODES and place == "delta_calibration.ros"
        own = [f"{place}.entry", name] if entered else [module]
        command = ["-m", *own, *arguments, *ros]
        started.append(NodeProcess(command, tmp_path / f"node_{len(started)}.log"))
        return started[-1]

    yield start
    for node in started:
        if node.process.poll() is None:
            node.process.kill()
            node.process.wait()
    if any(node.process.returncode == -signal.SIGKILL for node in started):
        remove_dead_shared_memory()


def yaml(value: object) -> str:
    """A parameter's value as written on a command line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(yaml(entry) for entry in value) + "]"
    if isinstance(value, str | os.PathLike):
        return f"'{value}'"
    return str(value)
