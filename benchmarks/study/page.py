"""The outcomes as a page of tables."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from study.mechanisms import mechanisms, robots
from study.outcomes import (
    CONFIDENT,
    LIKELY,
    NAMED,
    SURE,
    Outcome,
    alarm,
    confidently_wrong,
    exact,
    exact_classes,
    in_class,
    inside,
    named,
    nameless,
    of_class,
    only_twins,
    rate,
    recognised,
    table,
    weakest,
)
from study.statistics import Rate, calibration_error, reliability

_EDGES = (20.0, 40.0, 80.0, 160.0, 320.0, np.inf)  # lambda
_HARM = 0.1  # of the noise of a pose: the smallest loss that matters to the owner of a machine
_SLIGHT_UM = 0.1


def page(outcomes: Sequence[Outcome], wanted: int, command: str) -> str:
    """All tables as Markdown; `wanted` is the number of outcomes of the complete study."""
    of = {name: [o for o in outcomes if o["group"] == name] for name in _GROUPS}
    head = (
        "# How often the diagnosis is right\n\n"
        f"{len(outcomes)} machines, each with a session of its own"
        f"{', as far as the study has come' * (len(outcomes) < wanted)} (of {wanted}). "
        f"Made by `{command}`.\n\n"
        "Rates have their exact (Clopper-Pearson) 95 % interval and n beside them. lambda is that "
        "of the hidden cause, worked out by the generator: what geometry, frame, reflector offset "
        "and the rest errors of motions leave of it, squared, in standard deviations of noise.\n"
    )
    one = of["single"] + of["dimension"]
    parts = [
        head,
        *(
            [_section("By mechanism", mechanisms(outcomes))]
            if robots(outcomes) != ["srbd"]
            else []
        ),
        _section("Clean machines", _clean(of["none"])),
        _section("One cause: rates against its signal", _rates(one)),
        _section(f"One cause at lambda >= {NAMED:g}: what was named", _confusion(one)),
        _section(f"Two causes, each at lambda >= {SURE:g}", _pairs(of["pair"])),
        _section("A cause that is not in the catalogue", _unknown(of["unknown"])),
        _section("A cause removed from the catalogue", _taken_out(of["taken out"])),
        _section("Poor sessions", _poor(of["poor"])),
        _section("Gain where nothing was measured", _gain(outcomes)),
        _section("Stated intervals", _coverage(outcomes)),
        _section("Stated confidence", _confidence(outcomes)),
        _section("Time", _time(outcomes)),
    ]
    return "\n".join(parts)


_GROUPS = ("none", "single", "dimension", "pair", "unknown", "taken out", "poor")


def _section(title: str, body: str) -> str:
    return f"## {title}\n\n{body}\n"


# --- tables


def _clean(outcomes: Sequence[Outcome]) -> str:
    said = Counter(f["cause"] for o in outcomes for f in o["findings"])
    said.update("unknown structure" for o in outcomes if o["unknown"])
    by_name = ", ".join(f"{cause} {n}" for cause, n in said.most_common()) or "none"
    return f"Alarms: {rate(outcomes, alarm)}. By name: {by_name}.\n"


def _rates(outcomes: Sequence[Outcome]) -> str:
    groups = [
        (f"{low:g} to {high:g}", [o for o in outcomes if low <= weakest(o) < high])
        for low, high in pairwise(_EDGES)
    ]
    groups += [
        (f">= {least:g}", [o for o in outcomes if weakest(o) >= least]) for least in (NAMED, SURE)
    ]
    rows = [
        [
            name,
            rate(some, alarm),
            rate(some, in_class),
            rate(some, named),
            rate(some, confidently_wrong),
        ]
        for name, some in groups
    ]
    head = ["lambda", "seen", "class right", "name right", f"wrong, {CONFIDENT:.0%} sure"]
    return table(head, rows)


def _confusion(outcomes: Sequence[Outcome]) -> str:
    rows = []
    strong = [o for o in outcomes if weakest(o) >= NAMED]
    for cause in sorted({c for o in strong for c in o["hidden"]}):
        own = [o for o in strong if cause in o["hidden"]]
        rows.append([cause, len(own), _said(own)])
    return table(["hidden", "n", "reported"], rows)


def _said(outcomes: Sequence[Outcome]) -> str:
    counts = Counter(_sentence(o) for o in outcomes)
    return ", ".join(f"{name} {n}" for name, n in counts.most_common())


def _sentence(outcome: Outcome) -> str:
    names = [finding["cause"] for finding in outcome["findings"]]
    names += ["unknown structure"] if outcome["unknown"] else []
    return " + ".join(names) or "nothing"


def _pairs(outcomes: Sequence[Outcome]) -> str:
    strong = [o for o in outcomes if len(o["hidden"]) == 2 and weakest(o) >= SURE]
    both = rate(strong, exact)
    up_to_class = rate(strong, exact_classes)
    missed = [[" + ".join(o["hidden"]), _sentence(o)] for o in strong if not exact_classes(o)]
    return (
        f"Both named, and nothing else: {both}. The same up to what cannot be distinguished: "
        f"{up_to_class}.\n\n" + table(["hidden", "reported instead"], sorted(missed))
    )


def _unknown(outcomes: Sequence[Outcome]) -> str:
    rows = []
    strong = [o for o in outcomes if weakest(o) >= NAMED]
    for kind in sorted({_kind(o) for o in strong}):
        own = [o for o in strong if _kind(o) == kind]
        rows.append([kind, rate(own, recognised), rate(own, confidently_wrong), _said(own)])
    return (
        f"At lambda >= {NAMED:g}: recognised as unknown and nothing named with {LIKELY:.0%} "
        f"confidence or more {rate(strong, recognised)}, nothing named at all "
        f"{rate(strong, nameless)}; named with {CONFIDENT:.0%} confidence or more "
        f"{rate(strong, confidently_wrong)}.\n\n"
        + table(["hidden", "recognised", f"named, {CONFIDENT:.0%} sure", "reported"], rows)
    )


def _kind(outcome: Outcome) -> str:
    return str(json.loads(outcome["key"])["causes"][0][0])


def _taken_out(outcomes: Sequence[Outcome]) -> str:
    rows = []
    strong = [o for o in outcomes if weakest(o) >= NAMED]
    for cause in sorted({c for o in strong for c in o["hidden"]}):
        own = [o for o in strong if cause in o["hidden"]]
        rows.append([cause, len(own), _said(own)])
    told = [o for o in strong if not only_twins(o)]
    return (
        "Where what was named instead does the same in that session, the two are one class: "
        f"{len(strong) - len(told)} of {len(strong)} at lambda >= {NAMED:g}. "
        f"Of the others, recognised as unknown and nothing named with {LIKELY:.0%} confidence "
        f"or more {rate(told, recognised)}, nothing named at all {rate(told, nameless)}; "
        f"something named with {CONFIDENT:.0%} confidence or more "
        f"{rate(strong, confidently_wrong)}.\n\n" + table(["removed", "n", "reported"], rows)
    )


def _poor(outcomes: Sequence[Outcome]) -> str:
    rows = []
    for plan in sorted({o["plan"] for o in outcomes}):
        own = [o for o in outcomes if o["plan"] == plan and weakest(o) >= NAMED]
        rows.append(
            [
                plan,
                rate(own, named),
                rate(own, in_class),
                rate(own, confidently_wrong),
                rate(own, lambda o: bool(o["cannot_tell"])),
            ]
        )
    sure = f"wrong, {CONFIDENT:.0%} sure"
    head = ["plan", "name right", "class right", sure, "states what it cannot distinguish"]
    wrong = [
        [" + ".join(o["hidden"]), o["plan"], _sentence(o)]
        for o in outcomes
        if confidently_wrong(o)
    ]
    return (
        f"Causes at lambda >= {NAMED:g} of such a session.\n\n"
        + table(head, rows)
        + ("\n" + table(["hidden", "plan", "said wrongly"], wrong) if wrong else "")
    )


def _gain(outcomes: Sequence[Outcome]) -> str:
    one_or_two = [
        o
        for o in outcomes
        if "oracle" in o["error_um"]
        and o["hidden"]
        and weakest(o) >= NAMED
        and o["group"] in ("single", "pair")
    ]
    had = np.array([_gained(o, "extended") for o in one_or_two])
    could = np.array([_gained(o, "oracle") for o in one_or_two])
    told = [o for o in outcomes if o["error_um"]]
    share = float(had.sum() / could.sum()) if len(one_or_two) else float("nan")
    return (
        f"{len(one_or_two)} machines with causes at lambda >= {NAMED:g}: the extended models take "
        f"away {share:.1%} of the mean square error that models with the true causes take away, "
        "at places, payloads and speeds that were not measured.\n\n"
        "Extended models that predict worse than the calibrated one: by more than "
        f"{_HARM:.0%} of the noise of a pose (about 1 um) {rate(told, _harmful)}; by more than "
        f"{_SLIGHT_UM:g} um {rate(told, _slightly_worse)}. Every parameter more costs a little "
        "certainty: models with the true causes are worse by that much in "
        f"{rate([o for o in told if 'oracle' in o['error_um']], _true_worse)}.\n"
    )


def _gained(outcome: Outcome, model: str) -> float:
    """Share of the mean square error that a model removes."""
    error = outcome["error_um"]
    return float(1 - (error[model] / error["calibrated"]) ** 2)


def _harmful(outcome: Outcome) -> bool:
    return _worse(outcome, "extended") > _HARM * float(outcome["noise_um"])


def _slightly_worse(outcome: Outcome) -> bool:
    return _worse(outcome, "extended") > _SLIGHT_UM


def _true_worse(outcome: Outcome) -> bool:
    return _worse(outcome, "oracle") > _SLIGHT_UM


def _worse(outcome: Outcome, model: str) -> float:
    """Prediction error of a model minus that of the calibrated one [um]."""
    error = outcome["error_um"]
    return float(error[model] - error["calibrated"])


def _coverage(outcomes: Sequence[Outcome]) -> str:
    rows: dict[str, list[bool]] = {}
    for outcome in outcomes:
        for item in outcome["intervals"]:
            rows.setdefault(item["of"].split(".")[0], []).append(inside(item))
    every = [held for some in rows.values() for held in some]
    by_cause = [[cause, Rate(sum(some), len(some))] for cause, some in sorted(rows.items())]
    return f"95 % intervals that hold the true value: {Rate(sum(every), len(every))}.\n\n" + table(
        ["cause", "held"], by_cause
    )


def _confidence(outcomes: Sequence[Outcome]) -> str:
    stated, right = [], []
    for outcome in outcomes:
        for finding in outcome["findings"]:
            stated.append(finding["confidence"])
            right.append(of_class(outcome, finding))
    rows = [
        [f"{low:.2f} to {high:.2f}", f"{mean:.3f}", rate]
        for low, high, mean, rate in reliability(stated, right)
    ]
    return (
        f"Calibration error over all findings: {calibration_error(stated, right):.3f}.\n\n"
        + table(["stated", "mean", "right"], rows)
    )


def _time(outcomes: Sequence[Outcome]) -> str:
    seconds = np.array([o["seconds"] for o in outcomes])
    if not len(seconds):
        return "No trial yet.\n"
    low, high = np.median(seconds), np.quantile(seconds, 0.95)
    return f"A verdict took {low:.1f} s (median), {high:.1f} s (95th percentile), workers busy.\n"
