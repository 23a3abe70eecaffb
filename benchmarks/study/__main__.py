"""Runs the study: `make study`."""

from __future__ import annotations

import os
from pathlib import Path

for library in ("OPENBLAS", "MKL", "OMP"):  # one thread a process: the matrices are small
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import click

from study.judge import judge
from study.page import page
from study.running import outcomes
from study.trials import ROBOTS, tasks


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--scheduler", metavar="ADDRESS", help="Address of a Dask cluster with this checkout."
)
@click.option(
    "--workers",
    type=click.IntRange(1),
    help="Workers of the local cluster.  [default: number of cores]",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option(
    "--share",
    type=click.FloatRange(0, min_open=True),
    default=1.0,
    show_default=True,
    help="Share of the trials to run: 0.1 for a tenth of each kind.",
)
@click.option("--only", multiple=True, metavar="GROUP", help="Kinds of trials; may be repeated.")
@click.option(
    "--robots",
    default="srbd",
    show_default=True,
    metavar="NAMES",
    help=f"Robots, separated by commas, or all: {', '.join(ROBOTS)}.",
)
@click.option("--most", type=click.IntRange(1), help="Largest number of trials of each robot.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/study.jsonl"),
    show_default=True,
    help="File of outcomes, one per line; trials that are in it are not run again.",
)
@click.option("--page", "document", type=click.Path(path_type=Path), help="File for the tables.")
def study(
    scheduler: str | None,
    workers: int | None,
    seed: int,
    share: float,
    only: tuple[str, ...],
    robots: str,
    most: int | None,
    out: Path,
    document: Path | None,
) -> None:
    """Run the study of the diagnosis."""
    named = ROBOTS if robots == "all" else tuple(robots.split(","))
    odd = [name for name in named if name not in ROBOTS]
    if odd:
        known = ", ".join(ROBOTS)
        raise click.BadParameter(
            f"{odd[0]!r} is not known; there are: {known}, all", param_hint="--robots"
        )
    wanted = [
        task
        for name in named
        for task in [t for t in tasks(seed, share, (name,)) if not only or t.group in only][:most]
    ]
    keys = [task.key for task in wanted]
    seen = outcomes(keys, judge, out, workers, scheduler)
    text = page(seen, len(keys), _command(seed, share, only, robots, most))
    if document is None:
        click.echo(text)
    else:
        document.write_text(text, encoding="utf-8")


def _command(seed: int, share: float, only: tuple[str, ...], robots: str, most: int | None) -> str:
    """The command that makes the page."""
    said = f"--seed {seed} --share {share:g}"
    said += "".join(f" --only '{group}'" if " " in group else f" --only {group}" for group in only)
    said += f" --robots {robots}" if robots != "srbd" else ""
    return f'make study STUDY_ARGS="{said}{"" if most is None else f" --most {most}"}"'


if __name__ == "__main__":
    study()
