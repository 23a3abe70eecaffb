"""The particle swarm compared with other ways to the same correction, to 1e-3 mm: `make bench`.

    python benchmarks/compensation.py                       the table
    python benchmarks/compensation.py --failures 200000     how often the swarm fails

All use the same three-sphere Delta, drawn within its tolerances, the same commands and targets,
and one core, in one run. Times are processor times; each target counts with the shortest of a few
repeats, because other programs can only lengthen them. Median, p99 and spread are taken over the
targets. A library that is not installed is named and left out: pip install '.[bench]'.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import dist
from time import process_time

for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

import plain_swarm
from delta_calibration.chain import Chain
from delta_calibration.compensation import (
    Apso,
    ApsoSettings,
    IdentifiedMachine,
    Newton,
    NewtonSettings,
    Swarm,
    backward_kernel,
)
from delta_calibration.compensation.backward_kernel import begin, scratch, stands
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.jit import compiled
from delta_calibration.robot import Robot, load_robot
from swarm_rivals import RIVALS, Objective, Solver, installed, root, solve

Array = NDArray[np.float64]
Found = tuple[Array, object]  # corrections [rad], evaluations
Way = Callable[[Array, Array, int], Found]  # of commands, targets, and the index of the first

TOLERANCE = 1e-6  # [m]
SINGLE, SLOW, BATCH = 2000, 20, 10_000  # targets
REPEATS, FEW = 10, 3  # repeats of each target; FEW for slow methods
RADIUS, LOW, HIGH = 0.5, -0.83, -0.63  # [m] disc of the paper, 200 mm high


@dataclass(frozen=True)
class Task:
    """One machine, its commands and the points that they are meant to reach."""

    mechanism: Mechanism
    geometry: Array
    q: Array  # (n, 3) [rad]
    target: Array  # (n, 3) [m]
    settings: ApsoSettings

    @property
    def machine(self) -> IdentifiedMachine:
        """The machine in the form that the compensation uses."""
        return machine_of(self.mechanism, self.geometry)


@dataclass(frozen=True)
class Row:
    """Result of one method; the time of a batch is divided by its number of targets."""

    name: str
    seconds: Array  # per target, one value for each batch
    evaluations: float
    reached: int
    tried: int


def machine_of(mechanism: Mechanism, geometry: Array) -> IdentifiedMachine:
    """Machine with these parameters (p,), without effects, its tool at the platform's centre."""
    chain = Chain(mechanism, np.zeros(3), 1.0)
    theta = chain.join(geometry, np.zeros(3), Frame.identity())
    return IdentifiedMachine(chain, theta, np.zeros(3))


def commands(robot: Robot, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points spread over the disc, (n, 3) [m], and the nominal joint angles for them, [rad]."""
    radius, angle = RADIUS * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
    height = rng.uniform(LOW, HIGH, n)
    target = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    drawing = robot.model("rotary_delta")
    return drawing.inverse(target, drawing.parameters.nominal), target


def drawn(mechanism: Mechanism, rng: np.random.Generator) -> Array:
    """Draw parameters (p,) of a machine within its tolerances."""
    parameters = mechanism.parameters
    return np.asarray(parameters.nominal + parameters.prior * rng.standard_normal(len(parameters)))


def make_task(n: int, seed: int) -> Task:
    """Make the machine and the targets on which all methods are tried."""
    robot, rng = load_robot("srbd"), np.random.default_rng(seed)
    mechanism = robot.model("rotary_delta")
    q, target = commands(robot, n, rng)
    settings = ApsoSettings(bound_rad=robot.limits.correction, tolerance=TOLERANCE)
    return Task(mechanism, drawn(mechanism, rng), q, target, settings)


def timed(task: Task, name: str, way: Way, n: int, size: int = 1) -> Row:
    """Time the correction of n targets, `size` at once; the shortest of several repeats counts.

    Whether a target was reached is checked with the mechanism's own forward kinematics.
    """
    parts = [slice(first, first + size) for first in range(0, n, size)]
    batches = [(task.q[rows], task.target[rows], rows.start) for rows in parts]
    seconds = np.full(len(batches), np.inf)
    for _ in range(REPEATS if n > SLOW else FEW):
        found = []
        for i, batch in enumerate(batches):
            start = process_time()
            found.append(way(*batch))
            seconds[i] = min(seconds[i], (process_time() - start) / size)
    dq = np.concatenate([each for each, _ in found])
    gap = np.linalg.norm(point(task)(task.q[:n] + dq) - task.target[:n], axis=1)
    reached = int(np.sum(gap <= TOLERANCE * (1 + 1e-6)))
    evaluations = float(np.mean([np.mean(count) for _, count in found]))
    return Row(name, seconds, evaluations, reached, n)


def point(task: Task) -> Callable[[Array], Array]:
    """The mechanism's own forward kinematics, (..., 3) -> (..., 3) [m]."""

    def at(q: Array) -> Array:
        found = task.mechanism.forward(q.reshape(-1, 3), task.geometry)
        return np.asarray(found).reshape(q.shape)

    return at


@compiled(alone=True)
def places(
    machine: backward_kernel.MachineRecord, signals: Array, room: backward_kernel.Place, q: Array
) -> Array:
    """Tool positions (n, 3) [m] by the compiled chain, NaN where it cannot be assembled."""
    found = np.full(q.shape, np.nan)
    for row in range(len(q)):
        begin(machine, room)
        if stands(machine, q[row], signals, room):
            found[row] = room.place
    return found


def fast_point(machine: IdentifiedMachine) -> Callable[[Array], Array]:
    """The same for the libraries, with little overhead around the compiled function."""
    signals = machine.resting(machine.mechanism.home[None]).rows[0].copy()
    compiled_machine, room = machine.compiled, scratch(machine.compiled, len(signals))
    return lambda q: places(compiled_machine, signals, room, q)


def spheres(mechanism: Mechanism, g: Array) -> Array:
    """Spheres about the elbows, (3, 10): c, u, v, l with centre c + u cos q + v sin q [m].

    Computed from the elbows e at three angles; the derivative of the closure |x - e|^2 - l^2 is 2
    (x - e).
    """
    angles = np.repeat(np.array([[0.0], [np.pi / 2], [np.pi]]), mechanism.joints, axis=1)
    ahead, quarter, back = -mechanism.closure_by_pose(angles, np.zeros((3, 3)), g) / 2
    centre = (ahead + back) / 2
    rod = g.reshape(mechanism.joints, -1)[:, -1:]
    return np.hstack([centre, (ahead - back) / 2, quarter - centre, rod])


def our_swarms(task: Task) -> Iterator[Row]:
    """Time the compiled `Swarm`, the numpy `Apso` and the one in plain Python."""
    s = task.settings
    legs = spheres(task.mechanism, task.geometry).tolist()
    swarm, by_numpy = Swarm(task.machine, s), Apso(point(task), s)

    def compiled_swarm(q: Array, target: Array, _: int) -> Found:
        found = swarm.correct(q, target)
        return found.dq, found.evaluations

    def numpy_swarm(q: Array, target: Array, _: int) -> Found:
        found = by_numpy.correct(q, target)
        return found.dq, found.evaluations

    def plain(q: Array, target: Array, number: int) -> Found:
        told, p = q[0].tolist(), target[0].tolist()

        def distance(dq: list[float]) -> float:
            there = [a + b for a, b in zip(told, dq, strict=True)]
            try:
                return dist(plain_swarm.meeting_point(legs, there), p)
            except ValueError:
                return np.inf

        dq, _, evaluations = plain_swarm.search(distance, 3, s, random.Random(number))
        return np.array([dq]), evaluations

    yield timed(task, "APSO, compiled", compiled_swarm, SINGLE)
    yield timed(task, f"APSO, compiled, {BATCH} at once", compiled_swarm, BATCH, BATCH)
    yield timed(task, "APSO, numpy", numpy_swarm, SLOW)
    yield timed(task, "APSO, numpy, 256 at once", numpy_swarm, 256, 256)
    yield timed(task, "APSO, plain Python loop", plain, SLOW)


def rivals(task: Task) -> Iterator[Row]:
    """Time the libraries, each on the first targets."""
    fast, bound = fast_point(task.machine), task.settings.bound_rad

    def by(solver: Solver) -> Way:
        def way(q: Array, target: Array, number: int) -> Found:
            f = Objective(fast, q, target, bound, TOLERANCE)
            solve(solver, f, number)
            return bound * f.best[None], f.evaluations

        return way

    for name, solver in RIVALS.items():
        if installed(name):
            yield timed(task, name, by(solver), SLOW)
        else:
            print(f"{name} is not installed: pip install '.[bench]'", file=sys.stderr)
    yield timed(task, "scipy root", by(root), SINGLE)


def direct(task: Task) -> Iterator[Row]:
    """Time the methods without a swarm: Newton's method and the closed form, both compiled."""
    by_newton = Newton(task.machine, NewtonSettings(task.settings.bound_rad, TOLERANCE))

    def newton(q: Array, target: Array, _: int) -> Found:
        found = by_newton.correct(q, target)
        return found.dq, found.evaluations

    def closed(q: Array, target: Array, _: int) -> Found:
        return task.mechanism.inverse(target, task.geometry) - q, 0.0

    yield timed(task, "Newton, compiled", newton, SINGLE)
    yield timed(task, f"Newton, compiled, {BATCH} at once", newton, BATCH, BATCH)
    yield timed(task, "closed form", closed, SINGLE)
    yield timed(task, f"closed form, {BATCH} at once", closed, BATCH, BATCH)


def table(rows: list[Row]) -> str:
    """Format the rows as Markdown; ratios to the first row's median, 10th to 90th percentile.

    If a method was tried on only some of the targets, it is compared with the first method's
    median over those.
    """
    head = "way, median [us], p99 [us], times the first (10 % to 90 %), evaluations, reached"
    columns = head.split(", ")
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for row in rows:
        unit = np.median(rows[0].seconds[: row.tried])
        median, p99 = 1e6 * np.median(row.seconds), 1e6 * np.percentile(row.seconds, 99)
        low, middle, high = np.percentile(row.seconds, [10, 50, 90]) / unit
        ratio = f"{middle:.3g} ({low:.3g} to {high:.3g})"
        counts = f"{row.evaluations:.0f} | {row.reached} of {row.tried}"
        lines.append(f"| {row.name} | {median:.3g} | {p99:.3g} | {ratio} | {counts} |")
    return "\n".join(lines)


def failures(n: int, model: str, per_machine: int = 10) -> int:
    """Number of searches, out of n, that end farther than `TOLERANCE` from their target.

    The distance is computed with the mechanism's own forward kinematics. Each machine is drawn
    within its tolerances and has its own targets; its number is the seed of the swarm.
    """
    robot = load_robot("srbd")
    mechanism, rng = robot.model(model), np.random.default_rng(0)
    settings = ApsoSettings(bound_rad=robot.limits.correction, tolerance=TOLERANCE)
    failed, most = 0, 0
    for number in tqdm(range(0, n, per_machine), disable=not sys.stderr.isatty()):
        geometry = drawn(mechanism, rng)
        q, target = commands(robot, min(per_machine, n - number), rng)
        law = replace(settings, seed=number)
        found = Swarm(machine_of(mechanism, geometry), law).correct(q, target)
        there = mechanism.forward(q + found.dq, geometry)[:, :3]
        missed = ~(np.linalg.norm(there - target, axis=1) <= TOLERANCE * (1 + 1e-6))
        failed, most = failed + int(missed.sum()), max(most, int(found.evaluations.max()))
    print(f"{failed} of {n} searches failed, {model}; at most {most} evaluations of a target")
    return failed


def main() -> int:
    """Print the table, or the number of failures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--failures", type=int, metavar="N", help="count failures of N searches")
    parser.add_argument(
        "--model", default="rotary_delta", help="model of the machines with --failures"
    )
    chosen = parser.parse_args()
    if chosen.failures is not None:
        return int(failures(chosen.failures, chosen.model) > 0)
    task = make_task(BATCH, seed=0)
    home = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # pyswarms writes a log into the working directory
        rows = [*our_swarms(task), *rivals(task), *direct(task)]
        os.chdir(home)
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
