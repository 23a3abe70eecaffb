"""Trials spread over processes or a cluster; each outcome is a line of JSON, kept at once."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
from distributed import Client, LocalCluster, as_completed
from tqdm import tqdm

Work = Callable[[str], dict[str, Any]]


def outcomes(
    keys: Iterable[str], work: Work, out: Path, workers: int | None, scheduler: str | None = None
) -> list[dict[str, Any]]:
    """The outcomes of some trials; those that are in the file already are not made again.

    Args:
        keys: of the trials.
        work: makes the outcome of one, which holds its key.
        out: file of outcomes, one per line.
        workers: of a cluster of this machine; the number of cores if not given.
        scheduler: address of a Dask cluster to use instead.
    """
    wanted = dict.fromkeys(keys)
    known = {line["key"] for line in lines(out)}
    todo = [key for key in wanted if key not in known]
    if todo:
        _cut_to_whole_lines(out)
        _run(todo, work, out, scheduler, workers)
    return [line for line in lines(out) if line["key"] in wanted]


def lines(path: Path) -> list[dict[str, Any]]:
    """Outcomes in a file; an incomplete last line is ignored."""
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


def _run(
    todo: list[str], work: Work, out: Path, scheduler: str | None, workers: int | None
) -> None:
    """Run all trials; keep each outcome as soon as it is available."""
    if scheduler is not None:
        with Client(scheduler) as client:
            _keep(client, todo, work, out)
        return
    count = workers or os.cpu_count() or 1
    with (
        LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        _keep(client, todo, work, out)


def _keep(client: Client, todo: Iterable[str], work: Work, out: Path) -> None:
    futures = client.map(work, list(todo), pure=False)
    with out.open("a", encoding="utf-8") as file:
        for future in tqdm(as_completed(futures), total=len(futures), unit="trial"):
            if future.status == "error":
                click.echo(f"trial failed: {future.exception()!r}", err=True)
                continue
            file.write(json.dumps(future.result()) + "\n")
            file.flush()
            future.release()
