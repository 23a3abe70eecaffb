"""Table of the outcomes by mechanism, a row for each robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from study.outcomes import (
    CONFIDENT,
    NAMED,
    SURE,
    Outcome,
    alarm,
    confidently_wrong,
    exact_classes,
    in_class,
    inside,
    named,
    rate,
    recognised,
    table,
    weakest,
)
from study.statistics import Rate


def mechanisms(outcomes: Sequence[Outcome]) -> str:
    """Format a row for each robot: names, false alarms, unknown structure, intervals, time."""
    head = [
        "robot",
        "n",
        f"class right, lambda >= {NAMED:g}",
        f"class right, >= {SURE:g}",
        f"name right, >= {NAMED:g}",
        f"name right, >= {SURE:g}",
        "two causes",
        "alarms on clean",
        "unknown recognised",
        f"wrong, {CONFIDENT:.0%} sure",
        "95 % intervals that hold",
        "seconds (median, 95 %)",
        "of processor (median, 95 %, most)",
    ]
    rows = [_of_robot(name, outcomes) for name in robots(outcomes)]
    return table(head, rows)


def _of_robot(name: str, outcomes: Sequence[Outcome]) -> list[object]:
    own = [o for o in outcomes if robot_of(o) == name]
    one = [o for o in own if o["group"] in ("single", "dimension")]
    strong = [[o for o in one if weakest(o) >= least] for least in (NAMED, SURE)]
    pairs = [o for o in own if o["group"] == "pair" and weakest(o) >= SURE]
    unknown = [o for o in own if o["group"] == "unknown" and weakest(o) >= NAMED]
    return [
        name,
        len(own),
        *(rate(some, in_class) for some in strong),
        *(rate(some, named) for some in strong),
        rate(pairs, exact_classes),
        rate([o for o in own if o["group"] == "none"], alarm),
        rate(unknown, recognised),
        rate([o for o in own if o["hidden"]], confidently_wrong),
        _intervals(own),
        _spread([o["seconds"] for o in own]),
        _spread([o["processor"] for o in own if "processor" in o], most=True),
    ]


def robot_of(outcome: Outcome) -> str:
    return str(outcome.get("robot", "srbd"))


def robots(outcomes: Sequence[Outcome]) -> list[str]:
    return list(dict.fromkeys(map(robot_of, outcomes)))


def _intervals(outcomes: Sequence[Outcome]) -> Rate:
    every = [inside(item) for o in outcomes for item in o["intervals"]]
    return Rate(sum(every), len(every))


def _spread(seconds: Sequence[float], most: bool = False) -> str:
    if not len(seconds):
        return ""
    said = f"{np.median(seconds):.1f}, {np.quantile(seconds, 0.95):.1f}"
    return f"{said}, {max(seconds):.1f}" if most else said
