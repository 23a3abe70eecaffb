"""Runs the study: `make study`."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path

for library in ("OPENBLAS", "MKL", "OMP"):  # one thread a process: the matrices are small
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import click
from distributed import Client, LocalCluster, as_completed
from tqdm import tqdm

from study.judge import judge
from study.page import page
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
    known = {line["key"] for line in _lines(out)}
    todo = [task.key for task in wanted if task.key not in known]
    if todo:
        _cut_to_whole_lines(out)
        _run(todo, out, scheduler, workers)
    keys = {task.key for task in wanted}
    seen = [line for line in _lines(out) if line["key"] in keys]
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


def _lines(path: Path) -> list[dict[str, object]]:
    """Outcomes in the file; an incomplete last line is ignored."""
    if not path.exists():
        return []
    rows = path.read_text(encoding="utf-8").splitlines(keepends=True)
    return [json.loads(row) for row in rows if row.endswith("\n")]


def _cut_to_whole_lines(path: Path) -> None:
    """Remove an incomplete last line, so that appended outcomes start on their own line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    whole = path.read_bytes()
    os.truncate(path, whole.rfind(b"\n") + 1)


def _run(todo: list[str], out: Path, scheduler: str | None, workers: int | None) -> None:
    """Run all trials; keep each outcome as soon as it is available."""
    if scheduler is not None:
        with Client(scheduler) as client:
            _keep(client, todo, out)
        return
    count = workers or os.cpu_count() or 1
    with (
        LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        _keep(client, todo, out)


def _keep(client: Client, todo: Iterable[str], out: Path) -> None:
    futures = client.map(judge, list(todo), pure=False)
    with out.open("a", encoding="utf-8") as file:
        for future in tqdm(as_completed(futures), total=len(futures), unit="trial"):
            if future.status == "error":
                click.echo(f"trial failed: {future.exception()!r}", err=True)
                continue
            file.write(json.dumps(future.result()) + "\n")
            file.flush()
            future.release()


if __name__ == "__main__":
    study()
