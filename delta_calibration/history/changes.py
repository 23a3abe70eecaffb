"""The change log of a machine: which parameter changed between which sessions, and how much."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.history.few import pool
from delta_calibration.history.pooled import Dated
from delta_calibration.history.steps import FoundSteps, Steps, known_before
from delta_calibration.history.walk import DIMENSION, State, Step, Walk, days_between
from delta_calibration.robot import Robot
from delta_calibration.wording import figures, measured, spoken, sure

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NAMED = 0.5  # least probability of a cause for its sentence to have no caveat


@dataclass(frozen=True)
class Change:
    """A change of one cause between two consecutive sessions."""

    after: str  # id of the last session before the change
    before: str  # id of the first session after the change
    what: str  # fixed name of the cause
    location: str | None
    parameter: str  # name of the changed parameter; "amplitude" if several changed together
    from_: float
    to: float
    from_std: float
    to_std: float
    std: float  # of the difference
    unit: str
    confidence: float  # probability that cause, location and gap are right
    happened: float  # probability of any change, against none
    rivals: tuple[str, ...]  # alternative causes or gaps, with their probability
    signal: float  # lambda
    when: tuple[datetime, datetime]  # start times of these two sessions
    # each session's own value and standard deviation; all other parameters from all sessions
    course: tuple[tuple[float, float], ...]

    def as_dict(self) -> dict[str, Any]:
        """The change as a dictionary for other programs."""
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
        """Value before, value after and difference, as text in one common unit."""
        size = max(abs(self.from_), abs(self.to))
        values = (
            (self.from_, self.from_std),
            (self.to, self.to_std),
            (self.to - self.from_, self.std),
        )
        before, now, change = (measured(v, std, self.unit, size) for v, std in values)
        return before, now, change

    def gap(self) -> str:
        """The two sessions with their dates, and with times if both are of the same day."""
        first, last = self.when
        form = "%Y-%m-%d %H:%M" if first.date() == last.date() else "%Y-%m-%d"
        return f"{self.after} ({first:{form}}) and {self.before} ({last:{form}})"

    def sentence(self) -> str:
        """The change as one sentence for people."""
        where = f" of {spoken(self.location)}" if self.location else ""
        went = "went"
        if min(self.from_, self.to) >= 0:
            went = "grew" if self.to > self.from_ else "fell"
        before, now, change = self.told()
        said = (
            f"between {self.gap()} the {spoken(self.what)}{where} ({self.parameter}) "
            f"{went} from {before} to {now} (change {change}; {sure(self.confidence)} sure)"
        )
        if self.confidence < _NAMED:
            said += "; these sessions do not show which of several it was"
        return said + (f"; or: {', '.join(self.rivals)}" if self.rivals else "")


@dataclass(frozen=True)
class History:
    """Sessions of one machine and what changed between them."""

    sessions: tuple[str, ...]
    changes: tuple[Change, ...]
    before: Array  # (sessions,) chi square above that of the session's own fit, without changes
    after: Array  # (sessions,) the same with the changes
    # significant drifts by cause [tolerances (typical sizes of effects) / sqrt(day)]
    drift: tuple[tuple[str, float], ...] = ()

    def sentences(self) -> tuple[str, ...]:
        """The change log."""
        first, last = self.sessions[0], self.sessions[-1]
        if not self.changes:
            nothing = f"no change was found from {first} to {last}"
            return (nothing, *self._drifts())
        told = tuple(change.sentence() for change in self.changes)
        return (*told, "no other change was found", *self._drifts())

    def _drifts(self) -> tuple[str, ...]:
        """Sentence about the drift in addition to the changes; none if no drift is significant."""
        if not self.drift:
            return ()
        each = ", ".join(
            f"{spoken(cause)} by {figures(100 * speed, 2)} %" for cause, speed in self.drift
        )
        return (f"slow drift per day, as a fraction of the tolerance: {each}",)


def find_changes(
    sessions: Sequence[Dated],
    robot: Robot,
    model: str | None = None,
    named: Callable[[str], str] = str,
) -> History:
    """Find which parameters of a machine changed, and between which sessions.

    Each session has its own tracker frame and reflector offset. At least one session must have
    enough places for a fit by itself; the others may have few.

    Raises:
        DataError: fewer than two sessions, or a session that cannot be fitted.
    """
    if len(sessions) < 2:
        raise DataError(f"{len(sessions)} session in the history; changes need 2 or more")
    ordered = sorted(sessions, key=lambda each: each.began)
    found_in = pool(ordered, robot, model)
    parts = found_in.parts
    causes = {effect.cause for each in ordered for effect in each.effects}
    days = days_between([each.began.timestamp() for each in ordered])
    known = known_before([each.causes for each in ordered])
    steps = Steps(found_in.kept, parts, known, tuple(days.tolist()))
    found, walk = steps.search()
    walk = walk.stepped(each.step for each in found)
    return History(
        tuple(part.name for part in parts),
        changes_of(steps, found, walk, causes, named, [each.began for each in ordered]),
        _costs(walk.stepped(())),
        _costs(walk),
        walk.clear(),
    )


def changes_of(
    steps: Steps,
    found: Sequence[FoundSteps],
    walk: Walk,
    causes: Collection[str],
    named: Callable[[str], str],
    began: Sequence[datetime],
) -> tuple[Change, ...]:
    """Turn found steps into `Change` records, with the values before and after each step.

    Args:
        steps: the sessions and the candidate steps.
        found: steps that were found.
        walk: model with all found steps and the drift.
        causes: causes that the machine is known to have, in addition to those that stepped.
        named: function that gives the robot file's name of a parameter.
        began: start time of each session.
    """
    causes = {*causes, *(steps.key(step)[0] for step in walk.steps)}
    here = np.array([k.spread == DIMENSION or k.what in causes for k in steps.kept])
    walk = walk.only(here)
    return tuple(_change(steps, each, walk, here, named, began) for each in found)


def _change(
    steps: Steps,
    found: FoundSteps,
    walk: Walk,
    here: NDArray[np.bool_],
    named: Callable[[str], str],
    began: Sequence[datetime],
) -> Change:
    """Make the `Change` of one step; its values before and after use all sessions."""
    kept = [steps.kept[row] for row in found.step.rows]
    rows = np.cumsum(here)[list(found.step.rows)] - 1
    gap = found.step.gap
    nominal = np.array([k.nominal for k in kept])
    scale = np.array([k.scale for k in kept])
    first = _size(walk.smoothed(gap), rows, scale, nominal)
    last = _size(walk.smoothed(gap + 1), rows, scale, nominal)
    change = _size(walk.change(gap), rows, scale, 0.0 * nominal)
    what, location, _ = steps.key(found.step)
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
        when=(began[gap], began[gap + 1]),
        course=tuple(
            _size(_own(walk, number, rows), np.arange(len(rows)), scale, nominal)
            for number in range(len(walk.parts))
        ),
    )


def _own(walk: Walk, number: int, rows: Index) -> State:
    """One session's own estimate of some parameters, the others fixed at their smoothed values."""
    part, value = walk.parts[number], walk.smoothed(number).value
    left = part.right[rows] - part.information[rows] @ value
    known = np.linalg.pinv(part.information[np.ix_(rows, rows)], hermitian=True)
    return State(value[rows] + known @ left, np.asarray(known))


def _size(state: State, rows: Index, scale: Array, nominal: Array) -> tuple[float, float]:
    """A parameter and its standard deviation; of several, the norm of their vector."""
    vector = nominal + scale * state.value[rows]
    spread = scale[:, None] * state.covariance[np.ix_(rows, rows)] * scale
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


def _costs(walk: Walk) -> Array:
    """Chi square of each session above that of its own best fit, (sessions,)."""
    spread = np.diag([k.spread**-2.0 for k in walk.kept])
    costs = []
    for number, part in enumerate(walk.parts):
        own = np.linalg.solve(part.information + spread, part.right)
        off = walk.smoothed(number).value - own
        costs.append(float(off @ part.information @ off))
    return np.array(costs)
