"""The outcomes as tables, for people."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from study.statistics import Rate, calibration_error, reliability

Outcome = dict[str, Any]

_EDGES = (20.0, 40.0, 80.0, 160.0, 320.0, np.inf)  # lambda
_NAMED, _SURE = 80.0, 160.0
_CONFIDENT = 0.8
_LIKELY = 0.5  # a name less sure than this is by its own words less likely than not
_HARM = 0.1  # of the noise of a pose: a machine's owner would not notice less
_SLIGHT_UM = 0.1
_Z = 1.959964


def page(outcomes: Sequence[Outcome], wanted: int, seed: int, share: float) -> str:
    """All tables, as Markdown; `wanted` is how many outcomes the whole study has."""
    of = {name: [o for o in outcomes if o["group"] == name] for name in _GROUPS}
    command = f'make study STUDY_ARGS="--seed {seed} --share {share:g}"'
    head = (
        "# The diagnosis on trial\n\n"
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
        _section("Clean machines", _clean(of["none"])),
        _section("One cause: rates against its signal", _rates(one)),
        _section(f"One cause at lambda >= {_NAMED:g}: what was named", _confusion(one)),
        _section(f"Two causes, each at lambda >= {_SURE:g}", _pairs(of["pair"])),
        _section("A cause that no catalogue has", _unknown(of["unknown"])),
        _section("A cause taken out of the catalogue", _taken_out(of["taken out"])),
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


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines) + "\n"


def _rate(outcomes: Sequence[Outcome], holds: Callable[[Outcome], bool]) -> Rate:
    return Rate(sum(map(holds, outcomes)), len(outcomes))


# --- what was said of a session


def _weakest(outcome: Outcome) -> float:
    return min(outcome["hidden"].values(), default=0.0)


def _alarm(outcome: Outcome) -> bool:
    return bool(outcome["findings"] or outcome["unknown"])


def _first(outcome: Outcome) -> Outcome | None:
    return next(iter(outcome["findings"]), None)


def _named(outcome: Outcome) -> bool:
    """The right cause in the first place; in the right chain where it sits in one."""
    first = _first(outcome)
    return first is not None and _is(outcome, first)


def _is(outcome: Outcome, finding: Outcome) -> bool:
    if finding["cause"] not in outcome["hidden"]:
        return False
    where = outcome["location"].get(finding["cause"])
    return where is None or finding["location"] == where


def _in_class(outcome: Outcome) -> bool:
    """The right cause in the first place, or among what it cannot be told from."""
    first = _first(outcome)
    return first is not None and _of_class(outcome, first)


def _of_class(outcome: Outcome, finding: Outcome) -> bool:
    alike = bool(set(finding["equivalents"]) & set(outcome["hidden"]))
    return _is(outcome, finding) or alike or _twin(finding)


def _twin(finding: Outcome) -> bool:
    """Not to be told from the cause that was taken out of the catalogue."""
    return bool(finding.get("twin", False))


def _only_twins(outcome: Outcome) -> bool:
    said = outcome["findings"]
    return bool(said) and all(map(_twin, said)) and not outcome["unknown"]


def _confidently_wrong(outcome: Outcome) -> bool:
    return any(
        finding["confidence"] >= _CONFIDENT and not _of_class(outcome, finding)
        for finding in outcome["findings"]
    )


# --- tables


def _clean(outcomes: Sequence[Outcome]) -> str:
    said = Counter(f["cause"] for o in outcomes for f in o["findings"])
    said.update("unknown structure" for o in outcomes if o["unknown"])
    named = ", ".join(f"{cause} {n}" for cause, n in said.most_common()) or "none"
    return f"Alarms: {_rate(outcomes, _alarm)}. By name: {named}.\n"


def _rates(outcomes: Sequence[Outcome]) -> str:
    groups = [
        (f"{low:g} to {high:g}", [o for o in outcomes if low <= _weakest(o) < high])
        for low, high in pairwise(_EDGES)
    ]
    groups += [
        (f">= {least:g}", [o for o in outcomes if _weakest(o) >= least])
        for least in (_NAMED, _SURE)
    ]
    rows = [
        [
            name,
            _rate(some, _alarm),
            _rate(some, _in_class),
            _rate(some, _named),
            _rate(some, _confidently_wrong),
        ]
        for name, some in groups
    ]
    head = ["lambda", "seen", "class right", "name right", f"wrong, {_CONFIDENT:.0%} sure"]
    return _table(head, rows)


def _confusion(outcomes: Sequence[Outcome]) -> str:
    rows = []
    strong = [o for o in outcomes if _weakest(o) >= _NAMED]
    for cause in sorted({c for o in strong for c in o["hidden"]}):
        own = [o for o in strong if cause in o["hidden"]]
        rows.append([cause, len(own), _said(own)])
    return _table(["hidden", "n", "said"], rows)


def _said(outcomes: Sequence[Outcome]) -> str:
    counts = Counter(_sentence(o) for o in outcomes)
    return ", ".join(f"{name} {n}" for name, n in counts.most_common())


def _sentence(outcome: Outcome) -> str:
    names = [finding["cause"] for finding in outcome["findings"]]
    names += ["unknown structure"] if outcome["unknown"] else []
    return " + ".join(names) or "nothing"


def _pairs(outcomes: Sequence[Outcome]) -> str:
    strong = [o for o in outcomes if len(o["hidden"]) == 2 and _weakest(o) >= _SURE]
    exact = _rate(strong, _exact)
    up_to_class = _rate(strong, _exact_classes)
    missed = [[" + ".join(o["hidden"]), _sentence(o)] for o in strong if not _exact_classes(o)]
    return (
        f"Both named, and nothing else: {exact}. The same up to what cannot be told apart: "
        f"{up_to_class}.\n\n" + _table(["hidden", "said where that failed"], sorted(missed))
    )


def _exact(outcome: Outcome) -> bool:
    names = {finding["cause"] for finding in outcome["findings"]}
    return names == set(outcome["hidden"]) and not outcome["unknown"]


def _class(outcome: Outcome, finding: Outcome) -> set[str]:
    """A cause with all that the verdict says it cannot be told from, or may hold some of."""
    told = [set(some) for some in outcome["cannot_tell"] if finding["cause"] in some]
    return {finding["cause"], *finding["equivalents"]}.union(*told)


def _exact_classes(outcome: Outcome) -> bool:
    classes = [_class(outcome, finding) for finding in outcome["findings"]]
    hidden = set(outcome["hidden"])
    met = all(any(cause in some for some in classes) for cause in hidden)
    return met and all(hidden & some for some in classes) and not outcome["unknown"]


def _unknown(outcomes: Sequence[Outcome]) -> str:
    rows = []
    strong = [o for o in outcomes if _weakest(o) >= _NAMED]
    for kind in sorted({_kind(o) for o in strong}):
        own = [o for o in strong if _kind(o) == kind]
        rows.append([kind, _rate(own, _recognised), _rate(own, _confidently_wrong), _said(own)])
    return (
        f"At lambda >= {_NAMED:g}: recognised as unknown and nothing named with {_LIKELY:.0%} "
        f"confidence or more {_rate(strong, _recognised)}, nothing named at all "
        f"{_rate(strong, _nameless)}; named with {_CONFIDENT:.0%} confidence or more "
        f"{_rate(strong, _confidently_wrong)}.\n\n"
        + _table(["hidden", "recognised", f"named, {_CONFIDENT:.0%} sure", "said"], rows)
    )


def _kind(outcome: Outcome) -> str:
    return str(json.loads(outcome["key"])["causes"][0][0])


def _recognised(outcome: Outcome) -> bool:
    likely = any(finding["confidence"] >= _LIKELY for finding in outcome["findings"])
    return bool(outcome["unknown"] and not likely)


def _nameless(outcome: Outcome) -> bool:
    return bool(outcome["unknown"] and not outcome["findings"])


def _taken_out(outcomes: Sequence[Outcome]) -> str:
    rows = []
    strong = [o for o in outcomes if _weakest(o) >= _NAMED]
    for cause in sorted({c for o in strong for c in o["hidden"]}):
        own = [o for o in strong if cause in o["hidden"]]
        rows.append([cause, len(own), _said(own)])
    told = [o for o in strong if not _only_twins(o)]
    return (
        "Where what was named instead does the same in that session, the two are one class: "
        f"{len(strong) - len(told)} of {len(strong)} at lambda >= {_NAMED:g}. "
        f"Of the others, recognised as unknown and nothing named with {_LIKELY:.0%} confidence "
        f"or more {_rate(told, _recognised)}, nothing named at all {_rate(told, _nameless)}; "
        f"something named with {_CONFIDENT:.0%} confidence or more "
        f"{_rate(strong, _confidently_wrong)}.\n\n" + _table(["taken out", "n", "said"], rows)
    )


def _poor(outcomes: Sequence[Outcome]) -> str:
    rows = []
    for plan in sorted({o["plan"] for o in outcomes}):
        own = [o for o in outcomes if o["plan"] == plan and _weakest(o) >= _NAMED]
        rows.append(
            [
                plan,
                _rate(own, _named),
                _rate(own, _in_class),
                _rate(own, _confidently_wrong),
                _rate(own, lambda o: bool(o["cannot_tell"])),
            ]
        )
    sure = f"wrong, {_CONFIDENT:.0%} sure"
    head = ["plan", "name right", "class right", sure, "says what it cannot tell"]
    wrong = [
        [" + ".join(o["hidden"]), o["plan"], _sentence(o)]
        for o in outcomes
        if _confidently_wrong(o)
    ]
    return (
        f"Causes at lambda >= {_NAMED:g} of such a session.\n\n"
        + _table(head, rows)
        + ("\n" + _table(["hidden", "plan", "said wrongly"], wrong) if wrong else "")
    )


def _gain(outcomes: Sequence[Outcome]) -> str:
    named = [
        o
        for o in outcomes
        if "oracle" in o["error_um"]
        and o["hidden"]
        and _weakest(o) >= _NAMED
        and o["group"] in ("single", "pair")
    ]
    had = np.array([_gained(o, "extended") for o in named])
    could = np.array([_gained(o, "oracle") for o in named])
    told = [o for o in outcomes if o["error_um"]]
    share = float(had.sum() / could.sum()) if len(named) else float("nan")
    return (
        f"{len(named)} machines with causes at lambda >= {_NAMED:g}: the extended models take "
        f"away {share:.1%} of the mean square error that models with the true causes take away, "
        "at places, payloads and speeds that were not measured.\n\n"
        "Extended models that predict worse than the calibrated one: by more than "
        f"{_HARM:.0%} of the noise of a pose (about 1 um) {_rate(told, _harmful)}; by more than "
        f"{_SLIGHT_UM:g} um {_rate(told, _slightly_worse)}. Every parameter more costs a little "
        "certainty: models with the true causes are worse by that much in "
        f"{_rate([o for o in told if 'oracle' in o['error_um']], _true_worse)}.\n"
    )


def _gained(outcome: Outcome, model: str) -> float:
    """Share of the mean square error that a model takes away."""
    error = outcome["error_um"]
    return float(1 - (error[model] / error["calibrated"]) ** 2)


def _harmful(outcome: Outcome) -> bool:
    return _worse(outcome, "extended") > _HARM * float(outcome["noise_um"])


def _slightly_worse(outcome: Outcome) -> bool:
    return _worse(outcome, "extended") > _SLIGHT_UM


def _true_worse(outcome: Outcome) -> bool:
    return _worse(outcome, "oracle") > _SLIGHT_UM


def _worse(outcome: Outcome, model: str) -> float:
    """How much worse than the calibrated one a model predicts [um]; negative where better."""
    error = outcome["error_um"]
    return float(error[model] - error["calibrated"])


def _coverage(outcomes: Sequence[Outcome]) -> str:
    rows: dict[str, list[bool]] = {}
    for outcome in outcomes:
        for item in outcome["intervals"]:
            inside = abs(item["value"] - item["true"]) <= _Z * item["std"]
            rows.setdefault(item["of"].split(".")[0], []).append(inside)
    every = [inside for some in rows.values() for inside in some]
    table = [[cause, Rate(sum(some), len(some))] for cause, some in sorted(rows.items())]
    return (
        f"95 % intervals that hold the true value: {Rate(sum(every), len(every))}.\n\n"
        + _table(["cause", "held"], table)
    )


def _confidence(outcomes: Sequence[Outcome]) -> str:
    stated, right = [], []
    for outcome in outcomes:
        for finding in outcome["findings"]:
            stated.append(finding["confidence"])
            right.append(_of_class(outcome, finding))
    rows = [
        [f"{low:.2f} to {high:.2f}", f"{mean:.3f}", rate]
        for low, high, mean, rate in reliability(stated, right)
    ]
    return (
        f"Calibration error over all findings: {calibration_error(stated, right):.3f}.\n\n"
        + _table(["stated", "mean", "right"], rows)
    )


def _time(outcomes: Sequence[Outcome]) -> str:
    seconds = np.array([o["seconds"] for o in outcomes])
    if not len(seconds):
        return "No trial yet.\n"
    low, high = np.median(seconds), np.quantile(seconds, 0.95)
    return f"A verdict took {low:.1f} s (median), {high:.1f} s (95th percentile), workers busy.\n"
