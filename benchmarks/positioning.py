"""Residual distance and number of moves of the grid search without a model on simulated Deltas.

    python benchmarks/positioning.py

Each machine is drawn within its tolerances, comes to rest with the repeatability of its joints and
is measured by a noisy tracker, at ten points spread over the paper's disc and 0.1 m of height.
`before` and `after` are measured by the tracker, in a frame that was either found with it or is
known; `truly` is in the frame of the machine's own base, which no measurement of the robot alone
can find.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.cell.positioning import Positioning, TrackerFrame
from delta_calibration.compensation.joint_lattice import GridSettings
from delta_calibration.region import Region
from delta_calibration.robot import Robot, load_robot
from delta_calibration.ros.simulated_machine import SimulatedMachine
from delta_calibration.simulation import TrueMachine, draw_machine, standing

Array = NDArray[np.float64]

SEEDS = range(1, 11)
POINTS = 10
FRAME_STOPS = 24
READINGS = 10
MOVE_S = 1.0  # [s] between poses


@dataclass(frozen=True)
class Run:
    """Targets of one machine: arrays (n,), in [m] unless stated otherwise."""

    before: Array  # by the tracker
    after: Array
    truly_before: Array  # in the machine's own base
    truly_after: Array
    moves: Array
    frame_error: Array  # error of the targets by the frame that was found


def targets(seed: int, count: int) -> Array:
    """Draw tool points (n, 3) [m]."""
    rng = np.random.default_rng([seed, 9])
    r, angle = 0.45 * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    height = -0.761 + 0.1 * rng.random(count)
    return np.stack([r * np.cos(angle), r * np.sin(angle), height], axis=1)


def lattice(robot: Robot, unit_deg: float = 0.01, **more: object) -> GridSettings:
    """The paper's lattice for this robot."""
    unit = np.full(len(robot.joints.names), np.radians(unit_deg))
    joints = robot.joints
    return GridSettings(unit, joints.lower, joints.upper, robot.limits.correction, **more)


def drive(
    robot: Robot,
    seed: int,
    settings: GridSettings,
    points: int = POINTS,
    repeats: int = 3,
    frame_stops: int = FRAME_STOPS,
) -> Run:
    """Drive one machine to its targets; with `frame_stops` = 0 the tracker frame is known."""
    machine = draw_machine(robot, seed)
    simulated = SimulatedMachine(machine, np.random.default_rng([seed, 7]), 0.0)
    wanted = targets(seed, points)
    frame = frame_stops or truth(machine)
    work = Positioning(robot, wanted, settings, repeats, READINGS, frame)
    now = 0.0
    while not work.done:
        now += MOVE_S
        simulated.command(work.step, now)
        readings = [simulated.measure(now).position for _ in range(READINGS)]
        work.tell(np.mean(readings, axis=0))
    found = work.outcomes
    return Run(
        before=np.array([o.before for o in found]),
        after=np.array([o.after for o in found]),
        truly_before=_off(machine, np.array([o.command for o in found]), wanted),
        truly_after=_off(machine, np.array([o.joint for o in found]), wanted),
        moves=np.array([o.moves for o in found]),
        frame_error=_frame_error(machine, work.frame, wanted),
    )


def truth(machine: TrueMachine) -> Calibration:
    """A calibration with the machine's true values; it provides the true tracker frame."""
    joints = machine.robot.joints
    anywhere = Region(np.vstack([np.zeros(3), np.eye(3)]))
    return Calibration(
        machine.robot,
        machine.chain,
        machine.theta,
        anywhere,
        joints.lower,
        joints.upper,
        1e-5,
        "truth",
        seal="",
    )


def _off(machine: TrueMachine, joint: Array, wanted: Array) -> Array:
    return np.linalg.norm(machine.tool_points(standing(joint)) - wanted, axis=1)


def _frame_error(machine: TrueMachine, found: TrackerFrame | None, wanted: Array) -> Array:
    """Distance of each target, located by the identified frame, from its true position.

    A frame that was fitted to readings includes the offset of the reflector.
    """
    _, offset, frame = machine.chain.split(machine.theta)
    if found is None:
        return np.zeros(len(wanted))
    return np.linalg.norm(found.frame.apply(wanted) - frame.apply(wanted + offset), axis=1)


def _row(name: str, settings: GridSettings, robot: Robot, **more: int) -> str:
    runs = [drive(robot, seed, settings, **more) for seed in SEEDS]

    def both(what: str) -> str:
        values = 1e3 * np.concatenate([getattr(run, what) for run in runs])
        return f"{values.mean():.3f} | {values.max():.3f}"

    moves = np.concatenate([run.moves for run in runs])
    cells = [both("before"), both("after"), both("truly_before"), both("truly_after")]
    frame = np.concatenate([run.frame_error for run in runs])
    last = [f"{1e3 * frame.mean():.3f}", f"{moves.mean():.1f}", f"{moves.max()} |"]
    return " | ".join([f"| {name}", *cells, *last])


def main() -> None:
    """Print the table."""
    robot = load_robot("srbd")
    print(
        "| lattice | before: mean | max | after: mean | max | true error before: mean | max "
        "| true error after: mean | max | frame off | moves: mean | max |"
    )
    print("|---|" + "---|" * 11)
    print(_row("0.01 degree, 3 searches", lattice(robot), robot), flush=True)
    fine = lattice(robot, 0.002, spacing=64)
    print(_row("0.002 degree, 3 searches", fine, robot), flush=True)
    known = "0.01 degree, 3 searches, frame known"
    print(_row(known, lattice(robot), robot, frame_stops=0), flush=True)


if __name__ == "__main__":
    main()
