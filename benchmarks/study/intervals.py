"""Whether intervals hold on machines that share no code with the package, the causes known.

A session is made of a machine with one cause, and fitted with that cause in the chain: without
the search, whose choices the study judges, a machine takes seconds and there can be many.

    PYTHONPATH=test:benchmarks python -m study.intervals --robots all --seed 1 --machines 20

inside is the share of the true values within 1.96 stated standard deviations, spread the root
mean square of (stated - true) / standard deviation: 1 where all is right.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices are small

# The libraries read it when they are loaded, hence the imports after it.
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor

import click
import numpy as np

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.findings import items_of, spread_of
from delta_calibration.diagnosis.fitted import beside
from delta_calibration.diagnosis.model import fit
from delta_calibration.robot import load_robot
from study.judge import SAME, scaled, true_terms, true_value
from study.outcomes import table
from study.statistics import Rate
from study.trials import BEYOND_GEOMETRY, OF_ROBOT, ROBOTS, Task

_Z = 1.96
_LEAST, _MOST = 160.0, 5000.0  # lambda: of causes that a session tells


def drawn(robot: str, seed: int, machines: int) -> list[Task]:
    """So many machines of each cause whose values are described alike on both sides."""
    rng = np.random.default_rng([seed, ROBOTS.index(robot)])
    causes = BEYOND_GEOMETRY if robot == "srbd" else OF_ROBOT[robot][0]
    every = [cause for cause in causes if cause in SAME for _ in range(machines)]
    strengths = np.exp(rng.uniform(np.log(_LEAST), np.log(_MOST), len(every)))
    seeds = rng.permutation(10**6)[: len(every)]
    return [
        Task("single", int(number), ((cause, float(strength)),), robot=robot)
        for cause, strength, number in zip(every, strengths, seeds, strict=True)
    ]


def errors(task: Task) -> list[float]:
    """(stated - true) / standard deviation of each value of the cause; none where it cannot be."""
    trial, _ = scaled(task)
    robot = load_robot(task.robot)
    start = calibrated(survey(trial.session, robot.joints.names), robot)
    terms = true_terms(trial, start, robot)
    if terms is None:
        return []
    model = fit(start, terms)
    (term,) = model.terms
    items = items_of(model, term)
    spread = spread_of(beside(model.evidence, ()), model, term)[0]
    off = []
    for item, value, share in zip(items, model.values(term), spread, strict=True):
        for ours, theirs in SAME[term.cause].items():
            true = true_value(trial, term.cause, ours, item.name.removeprefix(theirs))
            if true is not None:
                off.append(float(value - true) / float(share * item.prior))
    return off


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--robots", default="srbd", show_default=True, help="With commas between, or all.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option("--machines", type=click.IntRange(1), default=20, show_default=True)
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
def intervals(robots: str, seed: int, machines: int, workers: int) -> None:
    """Count hidden values within their stated intervals."""
    named = ROBOTS if robots == "all" else tuple(robots.split(","))
    every = [task for robot in named for task in drawn(robot, seed, machines)]
    with ProcessPoolExecutor(workers) as pool:
        off = list(pool.map(errors, [*every]))
    rows = []
    for robot, cause in dict.fromkeys((task.robot, task.causes[0][0]) for task in every):
        own = [o for task, o in zip(every, off, strict=True) if _is(task, robot, cause)]
        rows.append((robot, cause, len(own), *_counted(own)))
    rows.append(("all", "", len(off), *_counted(off)))
    click.echo(table(("robot", "cause", "machines", "inside", "spread"), rows))


def _is(task: Task, robot: str, cause: str) -> bool:
    return task.robot == robot and task.causes[0][0] == cause


def _counted(off: Iterable[Sequence[float]]) -> tuple[Rate, str]:
    each = np.concatenate([np.asarray(o) for o in off])
    return Rate(int(np.sum(np.abs(each) <= _Z)), each.size), f"{np.sqrt(np.mean(each**2)):.2f}"


if __name__ == "__main__":
    intervals()
