"""What a diagnosis costs, and how it grows with the session and with the catalogue.

    python benchmarks/diagnosis.py [SESSION]

A session (a simulated two-hour one where none is given) is diagnosed as it is and at several times
its size: the same poses and paths again, with fresh noise. And with half the catalogue.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np

from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.samples import Paths, Poses, Session, Survey, joined, survey
from delta_calibration.simulation import draw_machine, simulate_session

SIZES = (1, 2, 5, 10)
NOISE = 8e-6  # [m]


def simulated(robot: Robot) -> Session:
    """Two hours of a machine with nothing hidden."""
    plan = make_plan("rich", robot, seed=1)
    return simulate_session(draw_machine(robot, 1), plan, 1, period=38.0)


def times(seen: Survey, count: int, rng: np.random.Generator) -> Survey:
    """So many times the poses and paths, one after the other, each with noise of its own."""
    poses, paths = seen.poses, seen.paths
    whole_poses, conditions = [], None
    for k in range(count):
        later = k * (poses.duration + 60.0)
        noise = (k > 0) * NOISE * rng.standard_normal(poses.point.shape)
        whole_poses.append(replace(poses, point=poses.point + noise, time=poses.time + later))
        at = replace(paths.conditions, time=paths.conditions.time + later)
        conditions = at if conditions is None else joined(conditions, at)
    return Survey(
        _together(whole_poses),
        Paths(
            conditions,
            np.tile(paths.count, count),
            np.concatenate([paths.path + k * (paths.path.max() + 1) for k in range(count)]),
        ),
    )


def _together(parts: list[Poses]) -> Poses:
    first = parts[0]
    each = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name, value in vars(first).items()
        if isinstance(value, np.ndarray) and len(value) == len(first)
    }
    return replace(first, **each)


def main() -> None:
    """Print the table."""
    robot = load_robot("srbd")
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    session = simulated(robot) if source is None else read_session(source)
    begin = time.perf_counter()
    seen = survey(session, robot.joints.names)
    read = time.perf_counter() - begin
    effects = catalogue(robot, robot.model())
    print(f"poses and paths found in {read:.2f} s\n")
    print("| poses | readings in motion | effects | diagnosis [s] | times the first |")
    print("|---|---|---|---|---|")
    rng, first = np.random.default_rng(0), 0.0
    for count, tried in [*((size, effects) for size in SIZES), (1, effects[::2])]:
        data = times(seen, count, rng)
        begin = time.perf_counter()
        diagnose(data, robot, effects=tried)
        took = time.perf_counter() - begin
        first = first or took
        sizes = f"{len(data.poses)} | {len(data.paths)} | {len(tried)}"
        print(f"| {sizes} | {took:.1f} | {took / first:.1f} |", flush=True)


if __name__ == "__main__":
    main()
