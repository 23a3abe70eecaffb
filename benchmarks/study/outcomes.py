"""Comparison of verdicts with what was hidden in the sessions; rates and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from study.statistics import Rate

Outcome = dict[str, Any]

NAMED, SURE = 80.0, 160.0  # lambda
CONFIDENT = 0.8
LIKELY = 0.5  # a name with less confidence is more probably wrong than right
_Z = 1.959964


def weakest(outcome: Outcome) -> float:
    return min(outcome["hidden"].values(), default=0.0)


def alarm(outcome: Outcome) -> bool:
    return bool(outcome["findings"] or outcome["unknown"])


def first(outcome: Outcome) -> Outcome | None:
    return next(iter(outcome["findings"]), None)


def named(outcome: Outcome) -> bool:
    """Whether the right cause is in the first place; in the right chain if it belongs to one."""
    said = first(outcome)
    return said is not None and is_cause(outcome, said)


def is_cause(outcome: Outcome, finding: Outcome) -> bool:
    if finding["cause"] not in outcome["hidden"]:
        return False
    where = outcome["location"].get(finding["cause"])
    return where is None or finding["location"] == where


def in_class(outcome: Outcome) -> bool:
    """Whether the right cause is in the first place, or listed as indistinguishable from it."""
    said = first(outcome)
    return said is not None and of_class(outcome, said)


def of_class(outcome: Outcome, finding: Outcome) -> bool:
    alike = bool(set(finding["equivalents"]) & set(outcome["hidden"]))
    return is_cause(outcome, finding) or alike or is_twin(finding)


def is_twin(finding: Outcome) -> bool:
    """Whether the finding is indistinguishable from the cause that was removed."""
    return bool(finding.get("twin", False))


def only_twins(outcome: Outcome) -> bool:
    said = outcome["findings"]
    return bool(said) and all(map(is_twin, said)) and not outcome["unknown"]


def confidently_wrong(outcome: Outcome) -> bool:
    return any(
        finding["confidence"] >= CONFIDENT and not of_class(outcome, finding)
        for finding in outcome["findings"]
    )


def exact(outcome: Outcome) -> bool:
    names = {finding["cause"] for finding in outcome["findings"]}
    return names == set(outcome["hidden"]) and not outcome["unknown"]


def class_of(outcome: Outcome, finding: Outcome) -> set[str]:
    """A cause with all that the verdict lists as indistinguishable or partly contained."""
    told = [set(some) for some in outcome["cannot_tell"] if finding["cause"] in some]
    return {finding["cause"], *finding["equivalents"]}.union(*told)


def exact_classes(outcome: Outcome) -> bool:
    classes = [class_of(outcome, finding) for finding in outcome["findings"]]
    hidden = set(outcome["hidden"])
    met = all(any(cause in some for some in classes) for cause in hidden)
    return met and all(hidden & some for some in classes) and not outcome["unknown"]


def recognised(outcome: Outcome) -> bool:
    likely = any(finding["confidence"] >= LIKELY for finding in outcome["findings"])
    return bool(outcome["unknown"] and not likely)


def nameless(outcome: Outcome) -> bool:
    return bool(outcome["unknown"] and not outcome["findings"])


def inside(item: Outcome) -> bool:
    return bool(abs(item["value"] - item["true"]) <= _Z * item["std"])


def rate(outcomes: Sequence[Outcome], holds: Callable[[Outcome], bool]) -> Rate:
    return Rate(sum(map(holds, outcomes)), len(outcomes))


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines) + "\n"
