"""Every method on every robot: error at places that were not measured, and cost.

    python benchmarks/methods.py            the table, written into docs/methods.md
    python benchmarks/methods.py --print    print the table only

Machines are drawn within each robot's tolerances and measured once at 40 places. At 100 other
places the distance between the reflector positions of the machine, without noise, and of the fit
is evaluated. Time is process time, relative to that of least squares on the same session in the
same run.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from delta_calibration.data import collect
from delta_calibration.estimation import Method, Problem, chain_of, prepare
from delta_calibration.papers import METHODS, method_named
from delta_calibration.plans import make_plan
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session, standing

Array = NDArray[np.float64]

PAGE = Path(__file__).parents[1] / "docs" / "methods.md"
BEGIN, END = "<!-- benchmarks/methods.py begins -->\n", "<!-- benchmarks/methods.py ends -->\n"
MEASURED, JUDGED = 40, 100  # places
ELSEWHERE = 1000  # added to the seed for the places of evaluation
NOTHING = "nominal + frame"


@dataclass(frozen=True)
class Outcome:
    """Result of one method on one machine."""

    off: float  # [m] root mean square distance at the other places
    worst: float  # [m] largest
    misfit: float  # root mean square whitened residual of the session itself
    evaluations: int
    seconds: float


@dataclass(frozen=True)
class Case:
    """A measured machine, and its positions at other places."""

    problem: Problem
    joint: Array  # (JUDGED, m)
    reached: Array  # (JUDGED, 3) [m] in the tracker's frame

    def judge(self, theta: Array, evaluations: int, seconds: float) -> Outcome:
        """Evaluate a fit at the other places."""
        said = self.problem.chain.predict(standing(self.joint), theta)
        off = np.linalg.norm(said - self.reached, axis=1)
        residual = self.problem.linearized(theta).residual
        misfit = float(np.sqrt(np.mean(residual**2)))
        return Outcome(
            float(np.sqrt(np.mean(off**2))), float(off.max()), misfit, evaluations, seconds
        )


def case(name: str, seed: int) -> Case:
    """Draw a machine of a robot, and measure it."""
    robot = load_robot(name)
    machine: TrueMachine = draw_machine(robot, seed)
    plan = make_plan("identify", robot, count=MEASURED, seed=seed)
    poses = collect(simulate_session(machine, plan, seed), robot.joints.names)
    joint = make_plan("identify", robot, count=JUDGED, seed=seed + ELSEWHERE).joint
    problem = prepare(poses, robot, chain_of(robot))[2]
    return Case(problem, joint, machine.reflector_points(standing(joint)))


def trial(measured: Case, method: Method, seed: int) -> Outcome:
    """Run one method on one machine."""
    begin = time.process_time()
    fit = method.fit(measured.problem, np.random.default_rng([seed, 2]), lambda _: None)
    seconds = time.process_time() - begin
    return measured.judge(fit.solution.theta, fit.evaluations, seconds)


def methods() -> dict[str, Method]:
    """The table's rows: all methods as they are by default, and the five-axis paper's order."""
    every = {name: method_named(name) for name in METHODS}
    return {**every, "stepwise_qpso, settled": method_named("stepwise_qpso", order="settled")}


def outcomes(name: str, seeds: int) -> dict[str, list[Outcome]]:
    """Results of each method on the same machines."""
    found: dict[str, list[Outcome]] = {method: [] for method in (NOTHING, *methods())}
    for seed in range(seeds):
        measured = case(name, seed)
        found[NOTHING].append(measured.judge(measured.problem.theta0, 0, 0.0))
        for key, method in methods().items():
            found[key].append(trial(measured, method, seed))
    return found


def rows(name: str, seeds: int) -> list[str]:
    """The rows of one robot: medians, with the largest values in brackets."""
    found = outcomes(name, seeds)
    usual = np.array([o.seconds for o in found[METHODS[0]]])
    lines = []
    for method, each in found.items():
        off = 1e3 * np.array([o.off for o in each])
        worst = 1e3 * max(o.worst for o in each)
        misfit = np.median([o.misfit for o in each])
        tried = int(np.median([o.evaluations for o in each]))
        ratio = np.median(np.array([o.seconds for o in each]) / usual)
        shown = "" if method == NOTHING else f"{ratio:.2g}"
        lines.append(
            f"| {name} | {method} | {np.median(off):.4f} ({off.max():.4f}) | {worst:.3f} "
            f"| {misfit:.3g} | {tried} | {shown} |"
        )
    return lines


def table(seeds: int, jobs: int) -> str:
    """The table of all robots, `jobs` robots at a time."""
    head = (
        "| robot | method | error elsewhere, mm RMS | worst place, mm | misfit | evaluations "
        "| time |\n|---|---|---|---|---|---|---|"
    )
    robots = known_robots()
    with ProcessPoolExecutor(jobs) as pool:
        parts = pool.map(rows, robots, repeat(seeds))
        bar = tqdm(parts, total=len(robots), unit="robot", delay=1.0, disable=None, leave=False)
        lines = [line for part in bar for line in part]
    said = f"{seeds} machines of each robot, seeds 0 to {seeds - 1}; median, largest in brackets."
    return "\n".join([said, "", head, *lines]) + "\n"


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=3, help="number of machines of each robot")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count(), help="number of robots processed in parallel"
    )
    parser.add_argument(
        "--print", action="store_true", help="print the table, do not change docs/methods.md"
    )
    asked = parser.parse_args()
    made = table(asked.machines, asked.jobs)
    if asked.print:
        print(made, end="")
        return
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}{made}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
