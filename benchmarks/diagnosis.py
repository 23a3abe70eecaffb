"""Time of a diagnosis, and its growth with the session and with the catalogue.

    python benchmarks/diagnosis.py

A simulated session of two hours is diagnosed alone and with further sessions of the same machine
appended, each with its own plan and noise; and once more with half of the catalogue.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from functools import reduce

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np

from delta_calibration.data import Paths, Poses, Survey, joined, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import RICH_PERIOD, draw_machine, simulate_session

SIZES = (1, 2, 5, 10)


def surveyed(robot: Robot, seed: int) -> Survey:
    """Two-hour session of a machine without hidden effects; plan and noise depend on the seed."""
    plan = make_plan("rich", robot, seed=seed)
    session = simulate_session(draw_machine(robot, 1), plan, seed, period=RICH_PERIOD)
    return survey(session, robot.joints.names)


def in_a_row(parts: list[Survey]) -> Survey:
    """Join sessions one after the other into one."""
    poses, conditions, path, begin, first = [], [], [], 0.0, 0
    for part in parts:
        poses.append(replace(part.poses, time=part.poses.time + begin))
        at = part.paths.conditions
        conditions.append(replace(at, time=at.time + begin))
        path.append(part.paths.path + first)
        begin += part.poses.duration + 60.0
        first += int(part.paths.path.max()) + 1
    count = np.concatenate([part.paths.count for part in parts])
    paths = Paths(reduce(joined, conditions), count, np.concatenate(path))
    return Survey(_together(poses), paths)


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
    parts = [surveyed(robot, seed) for seed in range(1, max(SIZES) + 1)]
    effects = catalogue(robot, robot.model())
    print("| poses | readings in motion | effects | diagnosis [s] | times the first |")
    print("|---|---|---|---|---|")
    first = 0.0
    for count, tried in [*((size, effects) for size in SIZES), (1, effects[::2])]:
        data = in_a_row(parts[:count])
        begin = time.perf_counter()
        diagnose(data, robot, effects=tried)
        took = time.perf_counter() - begin
        first = first or took
        sizes = f"{len(data.poses)} | {len(data.paths)} | {len(tried)}"
        print(f"| {sizes} | {took:.1f} | {took / first:.1f} |", flush=True)


if __name__ == "__main__":
    main()
