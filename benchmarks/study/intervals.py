"""Coverage of intervals on machines that share no code with the package, with known causes.

A session is made of a machine with one cause, and fitted with that cause in the chain. Without the
search, whose choices the study evaluates, a machine takes seconds, so there can be many.

    PYTHONPATH=test:benchmarks python -m study.intervals --robots all --seed 1 --machines 20

`inside` is the share of the true values within 1.96 stated standard deviations; `spread` is the
root mean square of (stated - true) / standard deviation, 1 where all is right.

To find out whether misses of a study are due to chance, the same machines are measured again with
other noise. This repeats the machines for which an interval of one cause missed, 14 times each:

    PYTHONPATH=test:benchmarks python -m study.intervals --of joint_lag out/study.jsonl --again 14

with the file of that study.
"""

from __future__ import annotations

import json
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices are small

# The libraries read it when they are loaded, hence the imports after it.
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import click
import numpy as np

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.findings import items_of, spread_of
from delta_calibration.diagnosis.fitted import beside
from delta_calibration.diagnosis.model import fit
from delta_calibration.robot import load_robot
from study.judge import SAME, scaled, true_terms, true_value
from study.outcomes import inside, table
from study.statistics import Rate
from study.trials import BEYOND_GEOMETRY, OF_ROBOT, ROBOTS, Task

_Z = 1.96
_LEAST, _MOST = 160.0, 5000.0  # lambda of causes that a session shows


def drawn(robot: str, seed: int, machines: int) -> list[Task]:
    """Draw this many machines for each cause whose values are described alike on both sides."""
    rng = np.random.default_rng([seed, ROBOTS.index(robot)])
    causes = BEYOND_GEOMETRY if robot == "srbd" else OF_ROBOT[robot][0]
    every = [cause for cause in causes if cause in SAME for _ in range(machines)]
    strengths = np.exp(rng.uniform(np.log(_LEAST), np.log(_MOST), len(every)))
    seeds = rng.permutation(10**6)[: len(every)]
    return [
        Task("single", int(number), ((cause, float(strength)),), robot=robot)
        for cause, strength, number in zip(every, strengths, seeds, strict=True)
    ]


def missed(path: Path, cause: str) -> list[Task]:
    """Machines of a study file for which an interval of a cause missed the true value."""
    lines = (json.loads(line) for line in path.read_text().splitlines())
    return [
        Task.of_key(line["key"])
        for line in lines
        if any(i["of"].split(".")[0] == cause and not inside(i) for i in line["intervals"])
    ]


def errors(task: Task, cause: str, again: int = 0) -> list[float]:
    """(stated - true) / standard deviation of each value of a cause; empty without a fit."""
    trial, _ = scaled(task, again)
    robot = load_robot(task.robot)
    start = calibrated(
        survey(trial.session, robot.joints.names, robot.commanded.joint_size), robot
    )
    terms = true_terms(trial, start, robot)
    if terms is None:
        return []
    model = fit(start, terms)
    term = next(term for term in model.terms if term.cause == cause)
    items = items_of(model, term)
    rest = tuple(other for other in model.terms if other is not term)
    spread = spread_of(beside(model.evidence, rest), model, term)[0]
    off = []
    for item, value, share in zip(items, model.values(term), spread, strict=True):
        for ours, theirs in SAME[cause].items():
            true = true_value(trial, cause, ours, item.name.removeprefix(theirs))
            if true is not None:
                off.append(float(value - true) / float(share * item.prior))
    return off


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--robots", default="srbd", show_default=True, help="Robots, separated by commas, or all."
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option("--machines", type=click.IntRange(1), default=20, show_default=True)
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
@click.option(
    "--of",
    type=(str, click.Path(exists=True, path_type=Path)),
    metavar="CAUSE FILE",
    help="Use the machines of a study whose values its intervals missed, not new ones.",
)
@click.option(
    "--again",
    type=click.IntRange(1),
    default=14,
    show_default=True,
    help="With --of: number of sessions of each machine.",
)
def intervals(
    robots: str, seed: int, machines: int, workers: int, of: tuple[str, Path] | None, again: int
) -> None:
    """Count hidden values within their stated intervals."""
    if of is None:
        named = ROBOTS if robots == "all" else tuple(robots.split(","))
        fresh = [task for robot in named for task in drawn(robot, seed, machines)]
        asked = [(task, task.causes[0][0], 0) for task in fresh]
    else:
        cause, path = of
        asked = [(t, cause, k) for t in missed(path, cause) for k in range(1, again + 1)]
    if not asked:
        raise click.ClickException("no interval was missed, or no machine asked for")
    with ProcessPoolExecutor(workers) as pool:
        off = list(pool.map(errors, *zip(*asked, strict=True)))
    own: dict[tuple[str, str], list[list[float]]] = {}
    for (task, cause, _), each in zip(asked, off, strict=True):
        own.setdefault((task.robot, cause), []).append(each)
    rows = [(robot, cause, len(o), *_counted(o)) for (robot, cause), o in own.items()]
    rows.append(("all", "", len(off), *_counted(off)))
    click.echo(table(("robot", "cause", "sessions", "inside", "spread"), rows))


def _counted(off: Iterable[Sequence[float]]) -> tuple[Rate, str]:
    each = np.concatenate([np.asarray(o) for o in off])
    return Rate(int(np.sum(np.abs(each) <= _Z)), each.size), f"{np.sqrt(np.mean(each**2)):.2f}"


if __name__ == "__main__":
    intervals()
