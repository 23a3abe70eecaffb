"""How often a law is right: for hidden structures, for removed causes, and on clean machines.

    PYTHONPATH=test:benchmarks python benchmarks/laws.py --seed 1 --each 2 --clean 20

The table shows for each kind: the laws reported; how many of these have the right stage, part,
variables and form; and the error where nothing was measured, calibrated and with the law.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from blind.causes import IN_NO_CATALOGUE
from blind.truths import TRUTHS, truth_of
from study.judge import judge, scaled
from study.laws import judge_law
from study.trials import Task

_WEAK, _STRONG = 160.0, 3000.0  # lambda


def tasks(seed: int, each: int, clean: int) -> list[Task]:
    """Make tasks: each kind and each cause `each` times with a random strength, and clean ones."""
    rng = np.random.default_rng([seed, 9])

    def strength() -> float:
        return float(np.exp(rng.uniform(np.log(_WEAK), np.log(_STRONG))))

    def numbered() -> Iterator[Task]:
        for kind in (f"unknown:{name}" for name in IN_NO_CATALOGUE):
            for _ in range(each):
                yield Task(kind, int(rng.integers(10**6)), ((kind, strength()),))
        for cause in TRUTHS:
            for _ in range(each):
                number = int(rng.integers(10**6))
                yield Task(f"without {cause}", number, ((cause, strength()),), without=cause)
        for _ in range(clean):
            yield Task("clean", int(rng.integers(10**6)))

    return list(numbered())


def outcome(key: str) -> dict[str, Any]:
    """Result of one trial: what was reported, and what of it is right."""
    task, found = Task.of_key(key), judge(key)
    named = [f["cause"] for f in found["findings"] if f["confidence"] > 0.8]
    law = judge_law(truth_of(scaled(task)[0]), found["laws"])
    return {
        "key": key,
        "group": task.group,
        "named": named,
        "unknown": found["unknown"],
        "lambda": sum(found["hidden"].values()),
        "error_um": found["error_um"],
        "seconds": found["seconds"],
        "laws": found["laws"],
        "told": law["said"],
        **law,
    }


def page(results: list[dict[str, Any]]) -> str:
    """Format the table."""
    head = "| kind | sessions | unknown | named | laws | stage | part | variables | form | um |"
    lines = [head, "|---|---" + "|---:" * 8 + "|"]
    for group in dict.fromkeys(r["group"] for r in results):
        own = [r for r in results if r["group"] == group]
        told = [r for r in own if r["told"]]
        right = [_count(told, key) for key in ("stage", "part", "variables", "form")]
        errors = [r["error_um"] for r in told if r["error_um"]]
        um = "; ".join(f"{e['calibrated']:.1f} -> {e['extended']:.1f}" for e in errors)
        unknown, named = sum(r["unknown"] for r in own), sum(bool(r["named"]) for r in own)
        counts = (group, len(own), unknown, named, len(told), *right, um)
        lines.append(f"| {' | '.join(str(count) for count in counts)} |")
    seconds = [r["seconds"] for r in results]
    lines.append(f"\nseconds a verdict: median {np.median(seconds):.1f}, most {max(seconds):.1f}")
    return "\n".join(lines)


def _count(told: list[dict[str, Any]], key: str) -> str:
    asked = [r[key] for r in told if r.get(key) is not None]
    return f"{sum(asked)} of {len(asked)}" if asked else "-"


def main() -> None:
    """Run the trials, keep each result, write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=2)
    parser.add_argument("--clean", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/laws.jsonl"))
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    keys = [task.key for task in tasks(given.seed, given.each, given.clean)]
    results = []
    with ProcessPoolExecutor(given.workers) as pool, given.out.open("w") as file:
        for result in pool.map(outcome, keys):
            results.append(result)
            file.write(json.dumps(result) + "\n")
            file.flush()
    print(page(results))


if __name__ == "__main__":
    main()
