"""The change log of a machine: what changed between which sessions, from what to what."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.history.pooled import Dated, pooled
from delta_calibration.history.steps import FoundSteps, Step, Steps
from delta_calibration.robot import Robot
from delta_calibration.wording import measured, spoken, sure

Array = NDArray[np.float64]

_NAMED = 0.5  # probability from which on a cause is told as the one


@dataclass(frozen=True)
class Change:
    """What changed between two sessions that follow each other."""

    after: str  # id of the last session before it
    before: str  # id of the first session behind it
    what: str  # cause, by the fixed names
    location: str | None
    parameter: str  # which number of it; its amplitude where there are several
    from_: float
    to: float
    from_std: float
    to_std: float
    std: float  # of the difference
    unit: str
    confidence: float  # probability of cause, place and gap
    happened: float  # probability that anything changed there
    rivals: tuple[str, ...]  # other names for the same, with their probability
    signal: float  # lambda

    def as_dict(self) -> dict[str, Any]:
        """As other programs read it."""
        return {
            "after": self.after,
            "before": self.before,
            "what": self.what,
            "location": self.location,
            "from": self.from_,
            "to": self.to,
            "std": self.std,
            "unit": self.unit,
            "confidence": self.confidence,
        }

    def told(self) -> tuple[str, str, str]:
        """What it was, what it is and how far that is apart, in one reader's unit."""
        size = max(abs(self.from_), abs(self.to))
        values = (
            (self.from_, self.from_std),
            (self.to, self.to_std),
            (self.to - self.from_, self.std),
        )
        before, now, change = (measured(v, std, self.unit, size) for v, std in values)
        return before, now, change

    def sentence(self) -> str:
        """For people."""
        where = f" of {spoken(self.location)}" if self.location else ""
        went = "went"
        if min(self.from_, self.to) >= 0:
            went = "grew" if self.to > self.from_ else "fell"
        before, now, change = self.told()
        said = (
            f"between {self.after} and {self.before} the {spoken(self.what)}{where} "
            f"({self.parameter}) {went} from {before} to {now} (change {change}; "
            f"{sure(self.confidence)} sure)"
        )
        if self.confidence < _NAMED:
            said += "; these sessions cannot tell which of several it was"
        return said + (f"; or: {', '.join(self.rivals)}" if self.rivals else "")


@dataclass(frozen=True)
class History:
    """Sessions of one machine and what changed between them."""

    sessions: tuple[str, ...]
    changes: tuple[Change, ...]
    before: Array  # (sessions,) chi square a number if nothing had changed
    after: Array  # (sessions,) the same with the changes

    def sentences(self) -> tuple[str, ...]:
        """The change log."""
        first, last = self.sessions[0], self.sessions[-1]
        if not self.changes:
            return (f"nothing changed from {first} to {last} that these sessions could show",)
        told = tuple(change.sentence() for change in self.changes)
        return (*told, "nothing else changed that these sessions could show")


def find_changes(
    sessions: Sequence[Dated],
    robot: Robot,
    model: str | None = None,
    named: Callable[[str], str] = str,
) -> History:
    """Search for what changed of a machine and when.

    The tracker's frame and the reflector's place are each session's own.

    Raises:
        DataError: fewer than two sessions, or one that cannot be fitted.
    """
    ordered = sorted(sessions, key=lambda each: each.began)
    kept, parts = pooled(ordered, robot, model)
    causes = {effect.cause for each in ordered for effect in each.effects}
    steps = Steps(kept, parts, frozenset(causes))
    found = steps.search()
    return _history(steps, found, causes, named)


def _history(
    steps: Steps, found: Sequence[FoundSteps], causes: set[str], named: Callable[[str], str]
) -> History:
    names = tuple(part.name for part in steps.parts)
    changed = [each.step for each in found]
    causes = causes | {steps.key(step)[0] for step in changed}
    geometry = np.array([k.spread == 1.0 for k in steps.kept])
    only = geometry | np.array([k.what in causes for k in steps.kept])
    value, covariance = steps.values(changed, only)
    told = tuple(_change(steps, each, changed, value, covariance, named) for each in found)
    none, _ = steps.values((), np.ones(len(only), dtype=bool))
    full, _ = steps.values(changed, np.ones(len(only), dtype=bool))
    return History(names, told, _costs(steps, (), none), _costs(steps, changed, full))


def _change(
    steps: Steps,
    found: FoundSteps,
    changed: Sequence[Step],
    value: Array,
    covariance: Array,
    named: Callable[[str], str],
) -> Change:
    """Values before and behind a step, with all steps of the same numbers before it in both."""
    rows, size = found.step.rows, len(value)
    kept = [steps.kept[row] for row in rows]
    before, step = np.zeros((len(rows), size)), np.zeros((len(rows), size))
    before[np.arange(len(rows)), list(rows)] = 1.0
    at = len(steps.kept)
    for other in changed:
        here = range(at, at + len(other.rows))
        if other is found.step:
            step[np.arange(len(rows)), list(here)] = 1.0
        elif other.gap < found.step.gap:
            for i, row in zip(here, other.rows, strict=True):
                if row in rows:
                    before[rows.index(row), i] = 1.0
        at += len(other.rows)
    nominal = np.array([k.nominal for k in kept])
    scale = np.array([k.scale for k in kept])[:, None]
    first = _size(scale * before, value, covariance, nominal)
    last = _size(scale * (before + step), value, covariance, nominal)
    change = _size(scale * step, value, covariance, np.zeros(len(rows)))
    what, location, gap = steps.key(found.step)
    return Change(
        after=steps.parts[gap].name,
        before=steps.parts[gap + 1].name,
        what=what,
        location=location,
        parameter=named(kept[0].name if len(kept) == 1 else "amplitude"),
        from_=first[0],
        to=last[0],
        from_std=first[1],
        to_std=last[1],
        std=change[1],
        unit=kept[0].unit,
        confidence=found.confidence,
        happened=found.happened,
        rivals=tuple(_rival(steps, each, p) for each, p in found.rivals),
        signal=found.signal,
    )


def _size(rows: Array, value: Array, covariance: Array, nominal: Array) -> tuple[float, float]:
    """A number with its standard deviation, of several the length of their vector."""
    vector = nominal + rows @ value
    spread = rows @ covariance @ rows.T
    if len(vector) == 1:
        return float(vector[0]), float(np.sqrt(spread[0, 0]))
    size = float(np.linalg.norm(vector))
    along = vector / size if size > 0 else vector
    return size, float(np.sqrt(max(float(along @ spread @ along), 0.0)))


def _rival(steps: Steps, step: Step, probability: float) -> str:
    what, location, gap = steps.key(step)
    where = f" of {spoken(location)}" if location else ""
    after, before = steps.parts[gap].name, steps.parts[gap + 1].name
    return f"{spoken(what)}{where} between {after} and {before} ({100 * probability:.0f} %)"


def _costs(steps: Steps, changed: Sequence[Step], value: Array) -> Array:
    """By how much each session's chi square is above its own best fit, (sessions,)."""
    costs = []
    for number, part in enumerate(steps.parts):
        x, at = value[: len(steps.kept)].copy(), len(steps.kept)
        for step in changed:
            if step.gap < number:
                x[list(step.rows)] += value[at : at + len(step.rows)]
            at += len(step.rows)
        spread = np.diag([k.spread**-2.0 for k in steps.kept])
        own = np.linalg.solve(part.information + spread, part.right)
        off = x - own
        costs.append(float(off @ part.information @ off))
    return np.array(costs)
