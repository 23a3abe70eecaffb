"""Accuracy of a table of corrections between its nodes, and time of a lookup compared with Newton.

    python benchmarks/table.py

Machines have errors within their tolerances; each has its own calibration over the disc that the
paper's line crosses. The error is the distance of the tool, by the identified model, from its
position with Newton's correction, at many places of the disc that are independent of the grid.
Times are the shortest of many short runs of `Table.at` and `Newton.correct`: a batch is 2000
commands; a single one is a call from Python.
"""

from __future__ import annotations

import os
import sys
import time
import timeit
from collections.abc import Callable

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.compensation import (
    IdentifiedMachine,
    JointCompensator,
    Newton,
    NewtonSettings,
    TableSettings,
)
from delta_calibration.geometry import Frame
from delta_calibration.plans import nominal_joints
from delta_calibration.region import Region
from delta_calibration.robot import Robot, load_robot

RADIUS, PLANE = 0.45 * np.sqrt(2), -0.711  # [m]
NODES = (15, 20, 40)
MACHINES, PLACES, BATCH = 6, 50_000, 2000


def disc(n: int, seed: int) -> np.ndarray:
    """Positions on the disc (n, 3) [m], a tenth of them on its rim."""
    rng = np.random.default_rng(seed)
    r = RADIUS * np.sqrt(np.where(np.arange(n) < n // 10, 1.0, rng.random(n)))
    turn = rng.uniform(0, 2 * np.pi, n)
    return np.stack([r * np.cos(turn), r * np.sin(turn), np.full(n, PLANE)], axis=1)


def machine(robot: Robot, model: str, seed: int) -> Calibration:
    """Calibration with the true parameters of a random machine, over the disc and its rim."""
    mechanism = robot.model(model)
    parameters = mechanism.parameters
    drawn = parameters.prior * np.random.default_rng(seed).standard_normal(len(parameters))
    chain = Chain(mechanism, np.zeros(3), 0.05)
    theta = chain.join(parameters.nominal + drawn, np.zeros(3), Frame.identity())
    lower, upper = robot.joints.lower, robot.joints.upper
    turn, radius = np.linspace(0, 2 * np.pi, 180, endpoint=False), RADIUS / np.cos(np.pi / 180)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(180, PLANE)], axis=1)
    region = Region.of(rim)
    return Calibration(robot, chain, theta, region, lower, upper, 1e-5, "bench", "0" * 64)


def identified(known: Calibration) -> IdentifiedMachine:
    """The machine of a calibration, with the robot's tool."""
    return IdentifiedMachine(known.chain, known.theta, known.robot.tool_offset)


def least(function: Callable[[], object], number: int, items: int, repeats: int) -> float:
    """Time per item [us]."""
    return 1e6 * min(timeit.repeat(function, number=number, repeat=repeats)) / number / items


def exactness(robot: Robot) -> None:
    """Print the largest error over all machines, by model and number of nodes."""
    q = nominal_joints(robot, disc(PLACES, 1))
    print("| model | nodes an axis | made in [s] | by its own check [um] | on the disc [um] |")
    print("|---|---|---|---|---|")
    for model in ("rotary_delta", "six_rod_delta"):
        made = [machine(robot, model, seed) for seed in range(MACHINES)]
        exact = [JointCompensator(each) for each in made]
        newton = [each.point(each.compensate(q).joint) for each in exact]
        for nodes in NODES:
            settings = TableSettings(nodes=nodes, most=nodes)
            start = time.perf_counter()
            tables = [JointCompensator(each, "table", table=settings) for each in made]
            seconds = (time.perf_counter() - start) / MACHINES
            off = [
                np.linalg.norm(t.point(q + t.table.at(q)) - there, axis=1).max()
                for t, there in zip(tables, newton, strict=True)
            ]
            found = max(t.table.worst for t in tables)
            errors = f"{1e6 * found:.2g} | {1e6 * max(off):.2g}"
            print(f"| {model} | {nodes} | {seconds:.2f} | {errors} |")


def cost(robot: Robot) -> None:
    """Print the time of a lookup, and of Newton's compiled search for the same corrections."""
    target = disc(BATCH, 2)
    q = nominal_joints(robot, target)
    settings = NewtonSettings(bound_rad=robot.limits.correction)
    print("\n| compiled | a command in a batch [us] | one alone [us] |")
    print("|---|---|---|")

    def row(name: str, call: Callable[[np.ndarray, np.ndarray], object]) -> None:
        first = q[:1].copy(), target[:1].copy()
        batch = least(lambda: call(q, target), 1, BATCH, 300)
        alone = least(lambda: call(*first), 20, 1, 3000)
        print(f"| {name} | {batch:.3f} | {alone:.2f} |")

    made = machine(robot, "six_rod_delta", 0)
    for nodes in NODES:
        settled = TableSettings(nodes=nodes, most=nodes)
        table = JointCompensator(made, "table", table=settled).table
        assert table is not None
        row(f"table, {nodes} nodes an axis", lambda a, b, table=table: table.at(a))
    for model in ("rotary_delta", "six_rod_delta"):
        known = machine(robot, model, 0)
        newton = Newton(identified(known), settings)
        row(f"newton, {model}", lambda a, b, newton=newton: newton.correct(a, b))


def main() -> int:
    """Print both tables."""
    robot = load_robot("srbd")
    exactness(robot)
    cost(robot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
