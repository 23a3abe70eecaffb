"""Two usual methods on sessions of the study, beside the diagnosis.

    PYTHONPATH=test:benchmarks python -m study.rivals out/study.jsonl --page out/rivals.md

The sessions of a study's outcomes are judged again by a plain search with the Bayesian information
criterion (`bic.py`), and by an amortised posterior (`amortised.py`) that is trained on other
sessions of the same generator: more than a user could give it. What a session does not distinguish
has one name only with these two methods, so a name counts as right here only if it is that of the
hidden cause, whatever a verdict says about indistinguishable ones.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

for library in ("OPENBLAS", "MKL", "OMP"):  # one thread a process: the matrices are small
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import click

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.effects import catalogue
from delta_calibration.robot import load_robot
from study.amortised import trained
from study.bic import candidates, chosen, gains
from study.judge import scaled
from study.outcomes import CONFIDENT, NAMED, SURE, Outcome, table, weakest
from study.running import lines, outcomes
from study.statistics import Rate
from study.trials import Task, tasks

Names = Sequence[Mapping[str, Any]]

_GROUPS = ("none", "single", "dimension", "pair")  # of the sessions for training
_SHAPES = 20  # of each effect, from which it is learned what a cause explains alone
_STUDIES = 2.0  # from which sessions for training are taken, the first ones of these groups


def judged(key: str) -> dict[str, Any]:
    """Names by BIC for a session, and what each cause alone explains of it."""
    return _begun(key, chosen)


def simulated(key: str) -> dict[str, Any]:
    """A session for training: what is hidden, and what each cause alone explains of it."""
    return _begun(key, None)


def _begun(key: str, search: Callable[..., Any] | None) -> dict[str, Any]:
    task = Task.of_key(key)
    trial, hidden = scaled(task)
    robot = load_robot(task.robot)
    effects = tuple(e for e in catalogue(robot, robot.model()) if e.cause != task.without)
    begin = time.process_time()
    seen = survey(trial.session, robot.joints.names, robot.commanded.joint_size)
    evidence = calibrated(seen, robot).evidence
    every = candidates(evidence, effects, _SHAPES)
    most: dict[str, float] = {"misfit": evidence.misfit}
    for candidate, gain in zip(every, gains(evidence, (), every).tolist(), strict=True):
        most[candidate.cause] = max(gain, most.get(candidate.cause, 0.0))
    found = [] if search is None else search(evidence, effects)
    return {
        "key": key,
        "hidden": hidden,
        "features": most,
        "bic": [{"cause": c.candidate.cause, "confidence": c.weight} for c in found],
        "processor": time.process_time() - begin,
    }


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("study", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--train", type=click.IntRange(100, 1500), default=1000, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of training.")
@click.option("--workers", type=click.IntRange(1), help="[default: number of cores]")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/rivals.jsonl"),
    show_default=True,
    help="File of sessions and names; those that are in it are not made again.",
)
@click.option("--page", type=click.Path(path_type=Path), help="File for the table.")
def rivals(
    study: Path, train: int, seed: int, workers: int | None, out: Path, page: Path | None
) -> None:
    """Compare the diagnosis of Deltas with BIC and an amortised posterior.

    STUDY is a file of outcomes of `python -m study`.
    """
    known = {line["key"]: line for line in lines(study) if line["robot"] == "srbd"}
    same = outcomes(known, judged, out, workers)
    keys = [task.key for task in tasks(seed, _STUDIES) if task.group in _GROUPS][:train]
    if set(keys) & set(known):
        raise click.BadParameter(
            "is that of the study: sessions would be known", param_hint="--seed"
        )
    lessons = outcomes(keys, simulated, out.with_suffix(".train.jsonl"), workers)
    posterior = trained(lessons, seed)
    ours = [(known[row["key"]], known[row["key"]]["findings"]) for row in same]
    by_bic = [(known[row["key"]], row["bic"]) for row in same]
    amortised = [(known[row["key"]], posterior.named(row["features"])) for row in same]
    text = table(
        [
            "",
            "diagnosis",
            "BIC over the catalogue",
            f"amortised posterior, {len(lessons)} sessions",
        ],
        compared(ours, by_bic, amortised),
    )
    if page is None:
        click.echo(text)
    else:
        page.write_text(text, encoding="utf-8")


def compared(*methods: Sequence[tuple[Outcome, Names]]) -> list[list[object]]:
    """Rows of the table: rates of each method over the same sessions."""
    return [[name, *(_rate(method, *what) for method in methods)] for name, what in _ROWS.items()]


def _rate(
    judged: Sequence[tuple[Outcome, Names]],
    groups: tuple[str, ...],
    least: float,
    holds: Callable[[tuple[Outcome, Names]], bool],
) -> Rate:
    """Rate over the sessions of some groups whose weakest cause has a least lambda."""
    some = [one for one in judged if one[0]["group"] in groups and weakest(one[0]) >= least]
    return Rate(sum(map(holds, some)), len(some))


def _first(one: tuple[Outcome, Names]) -> bool:
    """Whether the name in the first place is that of a hidden cause."""
    outcome, names = one
    return bool(names) and names[0]["cause"] in outcome["hidden"]


def _exact(one: tuple[Outcome, Names]) -> bool:
    outcome, names = one
    return {name["cause"] for name in names} == set(outcome["hidden"])


def _wrong(one: tuple[Outcome, Names]) -> bool:
    outcome, names = one
    return any(
        name["confidence"] >= CONFIDENT and name["cause"] not in outcome["hidden"]
        for name in names
    )


_ONE, _FOREIGN = ("single", "dimension"), ("unknown", "taken out")
_ROWS = {
    f"one cause, name right in the first place, lambda >= {NAMED:g}": (_ONE, NAMED, _first),
    f"one cause, this name and no other, lambda >= {NAMED:g}": (_ONE, NAMED, _exact),
    f"two causes, these names and no other, each lambda >= {SURE:g}": (("pair",), SURE, _exact),
    f"one or two causes, a wrong name {CONFIDENT:.0%} sure": ((*_ONE, "pair"), 0.0, _wrong),
    f"no cause of the catalogue, a name {CONFIDENT:.0%} sure": (_FOREIGN, 0.0, _wrong),
    "clean machines, a name": (("none",), 0.0, lambda one: bool(one[1])),
}


if __name__ == "__main__":
    rivals()
