"""The SCARA paper's experiment with a simulated camera: errors before and after the grid search.

    python benchmarks/camera_positioning.py

Machines are drawn within their tolerances. The camera hangs over the plane, tilted and rotated,
with pixel noise; the joints repeat to 12 urad. Unit and lattice are those of the paper (0.01
degree, k = 16). Both elbow postures are run. `before` and `after` are measured by the camera, in a
frame that was either found with the camera or is known; `truly` is the error of the tool in the
plane of the machine's own base.
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

from delta_calibration.cell.camera_frame import CameraFrame
from delta_calibration.cell.positioning import Positioning
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import (
    CameraOver,
    TrueMachine,
    draw_machine,
    other_elbow,
    standing,
)
from positioning import lattice

Array = NDArray[np.float64]

SEEDS = range(1, 11)
POINTS = 10
STOPS = 24
IMAGES = 10
REPEATS = 3
PRINTED = 0.081  # [mm] mean error after the search, table 2 of the paper


@dataclass(frozen=True)
class Run:
    """Targets of one machine in one posture: arrays (n,), in [m] unless stated otherwise."""

    before: Array  # by the camera
    after: Array
    truly_before: Array  # in the machine's own base
    truly_after: Array
    moves: Array


def targets(robot: Robot, seed: int, count: int) -> Array:
    """Draw tool points over the workspace, (count, 3) [m]."""
    rng = np.random.default_rng([seed, 9])
    workspace = robot.workspace
    if workspace is None:
        raise ValueError(f"robot {robot.name} has no workspace in its file")
    return np.asarray(workspace.centre + workspace.size * (rng.random((count, 3)) - 0.5))


def drive(
    machine: TrueMachine,
    seed: int,
    points: int = POINTS,
    stops: int = STOPS,
    repeats: int = REPEATS,
) -> Run:
    """Drive a machine to its targets; with `stops` = 0 the pose of the camera is known."""
    robot, rng = machine.robot, np.random.default_rng([seed, 7])
    camera = CameraOver.hung(machine, seed)
    wanted = targets(robot, seed, points)
    frame = stops or CameraFrame(robot.camera, camera.frame)
    work = Positioning(robot, wanted, lattice(robot), repeats, IMAGES, frame, robot.camera)
    while not work.done:
        work.tell(camera.look(work.step, IMAGES, rng).mean(axis=0))
    found = work.outcomes

    def off(joint: Array) -> Array:
        reached = machine.tool_points(standing(joint))
        return np.asarray(np.linalg.norm((reached - wanted)[:, :2], axis=1))

    return Run(
        before=np.array([o.before for o in found]),
        after=np.array([o.after for o in found]),
        truly_before=off(np.array([o.command for o in found])),
        truly_after=off(np.array([o.joint for o in found])),
        moves=np.array([o.moves for o in found]),
    )


def _row(name: str, stops: int, other: bool) -> str:
    runs = []
    for seed in SEEDS:
        machine = draw_machine(load_robot("scara"), seed)
        runs.append(drive(other_elbow(machine) if other else machine, seed, stops=stops))

    def both(what: str) -> str:
        values = 1e3 * np.concatenate([getattr(run, what) for run in runs])
        return f"{values.mean():.3f} | {values.max():.3f}"

    moves = np.concatenate([run.moves for run in runs])
    cells = [both("before"), both("after"), both("truly_before"), both("truly_after")]
    return " | ".join([f"| {name}", *cells, f"{moves.mean():.1f}", f"{moves.max()} |"])


def main() -> None:
    """Print the table."""
    print(
        "| elbow, camera | before: mean | max | after: mean | max | true error before: mean | max "
        "| true error after: mean | max | moves: mean | max |"
    )
    print("|---|" + "---|" * 10)
    for posture, other in (("as drawn", False), ("the other way", True)):
        print(_row(f"{posture}, place found by stops", STOPS, other), flush=True)
        print(_row(f"{posture}, place known", 0, other), flush=True)
    print(f"| paper 003, table 2 | 0.496 | | {PRINTED} | | | | | | | |")


if __name__ == "__main__":
    main()
