"""Shared by `node_rate.py` and `soak.py`: processes of nodes, and a calibration for them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from delta_calibration.data import Poses, collect
from delta_calibration.effects import effect_named
from delta_calibration.estimation import Identification, identify
from delta_calibration.plans import make_plan
from delta_calibration.processes import child_environment, remove_dead_shared_memory
from delta_calibration.robot import Robot
from delta_calibration.simulation import draw_machine, simulate_session

PATIENCE_S = 30.0
HERE = Path(__file__).parent


def identified(robot: Robot, seed: int = 1) -> tuple[Identification, Poses]:
    """Draw a machine of this robot, measure and fit it."""
    plan = make_plan("identify", robot, count=24, dwell=0.4)
    session = simulate_session(draw_machine(robot, seed), plan, seed)
    poses = collect(session, robot.joints.names)
    return identify(poses, robot), poses


def with_effects(
    found: Identification, robot: Robot, effects: Mapping[str, tuple[Mapping[str, object], float]]
) -> Identification:
    """The fit with these effects added: settings and value of each, by its cause."""
    mechanism = found.chain.mechanism
    made = [effect_named(cause, robot, mechanism, shape) for cause, (shape, _) in effects.items()]
    pairs = zip(made, effects.values(), strict=True)
    values = [np.full(len(effect.parameters), value) for effect, (_, value) in pairs]
    theta = np.concatenate([found.theta, *values])
    n = len(found.theta)
    covariance = np.diag(np.full(len(theta), 1e-12))
    covariance[:n, :n] = found.covariance
    chain = found.chain.with_effects(tuple(made))
    told = replace(found.uncertainty, covariance=covariance)
    return replace(found, chain=chain, theta=theta, covariance=covariance, uncertainty=told)


class Processes:
    """Python processes on their own ROS domain; those still running at the end are stopped."""

    def __init__(self, logs: Path) -> None:
        self.logs = logs
        self.domain = int(os.environ.get("ROS_DOMAIN_ID") or 1 + os.getpid() % 100)
        self.environment = child_environment(self.domain, local_only=True)
        sources = [str(HERE.parent), str(HERE), self.environment.get("PYTHONPATH", "")]
        self.environment["PYTHONPATH"] = os.pathsep.join(filter(None, sources))
        self._running: list[subprocess.Popen[bytes]] = []

    def start(self, name: str, module: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        """Run `python -m module`; its output is appended to the log of this name."""
        with (self.logs / f"{name}.log").open("ab") as log:
            child = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._running.append(child)
        return child

    def call(self, service: str, *value: str) -> None:
        """Call a service, and raise an error if it does not succeed."""
        arguments = [service, *value, str(PATIENCE_S)]
        child = self.start("trigger", "delta_calibration.ros.trigger", arguments)
        if child.wait(PATIENCE_S + 10.0) != 0:
            raise RuntimeError(f"{service}: {(self.logs / 'trigger.log').read_text()}")

    def stop(self) -> None:
        """Stop all processes, with SIGINT and then SIGKILL."""
        for order in (signal.SIGINT, signal.SIGKILL):
            alive = [child for child in self._running if child.poll() is None]
            for child in alive:
                child.send_signal(order)
            for child in alive:
                try:
                    child.wait(8.0)
                except subprocess.TimeoutExpired:
                    continue
        if any(child.returncode == -signal.SIGKILL for child in self._running):
            remove_dead_shared_memory()


@contextmanager
def processes(logs: Path) -> Iterator[Processes]:
    """Context with processes that are stopped at its end."""
    logs.mkdir(parents=True, exist_ok=True)
    running = Processes(logs)
    try:
        yield running
    finally:
        running.stop()


def given(**parameters: object) -> list[str]:
    """ROS arguments of these parameters."""
    text = {k: str(v).lower() if isinstance(v, bool) else str(v) for k, v in parameters.items()}
    return ["--ros-args", *(o for k, v in text.items() for o in ("-p", f"{k}:={v}"))]


def motion(middle: np.ndarray, t: float) -> np.ndarray:
    """A smooth command (3,) [rad] about the middle that never repeats."""
    turn = np.array([0.0, 2.1, 4.2])
    return middle + 0.05 * np.sin(2.0 * t + turn) + 0.02 * np.sin(5.3 * t)
