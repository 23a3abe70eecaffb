"""Live cell of the demonstration: its nodes as processes, and the stops of each measured part."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from delta_calibration.cli.children import Children
from delta_calibration.data import Poses
from delta_calibration.errors import DataError
from delta_calibration.plans import Plan
from delta_calibration.plans.motion import APPROACH
from delta_calibration.robot import Robot

RATE = 50.0  # [1/s] of commands, states and tracker
RADIUS = 0.45  # [m] of the disc
STOPS = {"identify": 48, "line": 37, "disc": 24}
_RAMP = 0.2  # [s] over which corrections are ramped in: short enough to end before the first stop
_DWELL = 0.25  # [s]
_NEAR = 0.6 * APPROACH  # [rad of a Delta] to a target; the approach turns back farther away
_TIMEOUT = 200.0  # [s] of one plan

Say = Callable[[str], None]


class LiveCell:
    """Runs recorder, simulated machine and calibration node; a context manager."""

    def __init__(
        self,
        robot_file: str,
        robot: Robot,
        session: Path,
        calibration: Path,
        seed: int,
        method: str,
        effects: tuple[str, ...] = (),
        number: int = 0,
    ) -> None:
        """A cell that records to `session`, writes `calibration` and hides `effects`.

        `number`, 0 or 1, tells the ROS domains of two cells of this process apart.
        """
        self._robot_file, self._robot = robot_file, robot
        self._session, self._calibration = session, calibration
        self._seed, self._method, self._effects = seed, method, effects
        self.begun: dict[str, int] = {}  # when each part began [ns]
        self.domain = 1 + 2 * (os.getpid() % 50) + number
        self._children = Children(self.domain, session.parent / "logs" / session.name)

    def __enter__(self) -> LiveCell:
        self._children.__enter__()
        common: dict[str, object] = {"robot": self._robot_file}
        said = f"robot={self._robot.name}, robot_sha256={self._robot.hash}, seed={self._seed}"
        provenance = f"[{said}, made_by=demo]"
        self._children.start(
            "session_recorder", {"output": self._session, "provenance": provenance}
        )
        machine = {**common, "seed": self._seed, "rate": RATE}
        if self._effects:
            machine["effects"] = f"[{', '.join(repr(effect) for effect in self._effects)}]"
        self._children.start("simulated_tracker", machine)
        node = {"autostart": True, "method": self._method, "ramp_s": _RAMP}
        self._children.start("calibration_node", {**common, **node, "output": self._calibration})
        return self

    def __exit__(self, *error: object) -> None:
        self._children.__exit__(*error)

    def measure(self, part: str, plan: str, both_sides: bool) -> None:
        """Run a plan on the machine; `part` is the name by which `part_of` finds its stops."""
        self.begun[part] = time.time_ns()
        self._children.plan(
            {
                "robot": self._robot_file,
                "plan": plan,
                "count": STOPS[plan],
                "dwell": _DWELL,
                "rate": RATE,
                "both_sides": both_sides,
                "radius": RADIUS,
                "seed": self._seed,
                "subscribers": 2,  # the calibration node and the recorder
            },
            _TIMEOUT,
        )

    def captured(self, say: Say) -> tuple[int, int]:
        """Measure the workspace; returns begin and end of the readings that the node captures."""
        self.order("start_capture")
        begun = time.time_ns()
        say(f"measuring the workspace: {STOPS['identify']} places from both sides")
        self.measure("identify", "identify", True)
        ended = time.time_ns()
        self.order("stop_capture")
        return begun, ended

    def order(self, service: str, value: bool | None = None) -> str:
        """Call a service of the calibration node and return the message of its answer."""
        return self._children.call(f"/calibration_node/{service}", value)


def part_of(poses: Poses, begun: dict[str, int], part: str) -> Poses:
    """Stops that began between the start of one part and the start of the next."""
    # The begin of a stop counts: the last one of a part lasts until the next plan has started.
    stamp = poses.start_ns + (poses.time - poses.count / (2 * RATE)) * 1e9
    end = min((other for other in begun.values() if other > begun[part]), default=np.inf)
    keep = np.flatnonzero((stamp >= begun[part]) & (stamp < end))
    if keep.size == 0:
        raise DataError(f"{poses.source}: no stops were recorded in part {part!r} of the demo")
    return poses.take(keep)


def at_targets(poses: Poses, plan: Plan, sides: int = 1, joint_size: float = 1.0) -> Poses:
    """Stops at the targets, one per side and target; rests elsewhere (the approach) are left out.

    `joint_size` is the joint motion, in the joints' unit, that corresponds to 1 rad of a Delta.
    """
    # With or without compensation, a stop is nearer to the plan's joints than its approach is. If
    # a busy machine lost a stop, the approach would be the nearest: `_NEAR` excludes it.
    distance = np.abs(poses.joint[:, None] - plan.joint).max(axis=-1)
    rows = np.unique(np.argsort(distance, axis=0)[:sides])
    return poses.take(rows[distance[rows].min(axis=1) < _NEAR * joint_size])


def clock() -> Say:
    """Return a function that prints lines with the time elapsed since this call."""
    begin = time.monotonic()
    return lambda text: click.echo(f"[{time.monotonic() - begin:5.1f} s] {text}")
