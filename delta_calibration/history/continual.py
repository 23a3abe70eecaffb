"""Prior of a machine's next session, from the sessions in its history.

Old sessions are linear evidence about the machine's dimensions and the effects that were found in
it (`pooled.py`). Between sessions the machine drifts, at the speed learnt from its history
(`walk.py`). If a parameter stepped (`steps.py`), between old sessions or before the new one, its
earlier estimate is discarded, and so are those of the step's rivals. Each session has its own
tracker frame and reflector offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from delta_calibration.errors import DataError
from delta_calibration.estimation import Carried
from delta_calibration.history.changes import Change, changes_of
from delta_calibration.history.few import carried_of, pool, pool_near, pool_with
from delta_calibration.history.pooled import Dated, Pool
from delta_calibration.history.steps import FoundSteps, Steps, known_before
from delta_calibration.history.walk import State, Step, Walk, days_between
from delta_calibration.robot import Robot
from delta_calibration.threads import one_thread
from delta_calibration.wording import spoken

_ODD = 1e-3  # p value below which a session contradicts the prior from its history


@dataclass(frozen=True)
class Prospect:
    """Prior of the machine's present parameters, from old sessions."""

    carried: Carried
    speed: tuple[tuple[str, float], ...]  # drift of each cause [typical sizes / sqrt(day)]
    changes: tuple[Change, ...]  # found changes; estimates from before them are discarded
    odd: float = 1.0  # factor on the prior's covariance if the new session contradicts it

    def changed_now(self, session: str) -> tuple[Change, ...]:
        """Changes in the gap just before a session."""
        return tuple(change for change in self.changes if change.before == session)

    def sentences(self, session: str) -> tuple[str, ...]:
        """Sentences: what the fit takes over from the history, and what changed before it."""
        effects = ", ".join(spoken(effect.cause) for effect in self.carried.effects)
        names, now = self.carried.sessions, self.changed_now(session)
        told = [
            f"carried over from {len(names)} session{'' if len(names) == 1 else 's'} "
            f"({names[0]} to {names[-1]}): geometry{f' and {effects}' if effects else ''}",
            *(
                f"changed: {change.sentence()}; its earlier estimates are discarded"
                for change in now
            ),
        ]
        if not now:
            told.append("this session shows no change since then")
        return tuple(told)

    @property
    def doubt(self) -> str:
        """Warning that a session contradicts its history; empty if it does not."""
        if self.odd == 1:
            return ""
        return (
            f"the session contradicts its history ({self.odd:.1f} times what drift and noise "
            "explain); the history is given less weight accordingly: measure a whole plan"
        )


@one_thread()
def prospect(
    sessions: Sequence[Dated],
    robot: Robot,
    new: Dated | None = None,
    model: str | None = None,
) -> Prospect:
    """Predict a machine's parameters for its next session, as the prior of that session's fit.

    Args:
        sessions: sessions of its history; only those that began before the new one are used.
        robot: drawing, tolerances, tracker.
        new: session that is to be fitted. It is only used to find changes before it and to widen
            the prior if it contradicts it. If None, the next session is assumed to follow the
            last one after the median gap of the history.
        model: name of a mechanism; by default the robot file's own.

    Raises:
        DataError: no session before the new one, or a session that cannot be fitted.
    """
    old = sorted(sessions, key=lambda each: each.began)
    if new is not None:
        old = [each for each in old if each.began < new.began]
    if not old:
        raise DataError(
            "no session in the history began before this one; an update needs at least one"
            if new is not None
            else "no session in the history; an update needs at least one"
        )
    every = old if new is None else [*old, new]
    whole = pool_near(pool(old, robot, model), old, robot, model)
    if new is not None:
        whole = pool_with(whole, old, new, robot, model)
    causes = {effect.cause for each in old for effect in each.effects}
    days = days_between([each.began.timestamp() for each in every])
    known = known_before([each.causes for each in every])
    steps = Steps(whole.kept, whole.parts, known, tuple(days.tolist()))
    found, walk = steps.search()
    began = [each.began for each in every]
    told = changes_of(steps, found, walk, causes, robot.named, began)
    causes |= {steps.key(step)[0] for step in walk.steps}
    small = whole.only(causes)
    state, odd = _next(_believed(small, found, steps, walk, len(old)), new)
    return Prospect(carried_of(small, state, old), walk.speed, told, odd)


def _believed(
    small: Pool, found: Sequence[FoundSteps], steps: Steps, walk: Walk, old: int
) -> Walk:
    """Reduced model with all steps and rivals; its drift is learnt from the old sessions alone."""
    row = {(kept.name, kept.group): number for number, kept in enumerate(small.kept)}
    stepped = [*walk.steps, *(rival for each in found for rival, _ in each.rivals)]
    forgotten = []
    for step in stepped:
        names = [(steps.kept[k].name, steps.kept[k].group) for k in step.rows]
        rows = tuple(row[name] for name in names if name in row)
        if rows:
            forgotten.append(Step(rows, step.gap))
    every = Walk(small.kept, small.parts, walk.days, tuple(forgotten))
    past = tuple(step for step in forgotten if step.gap < old - 1)
    before = Walk(small.kept, small.parts[:old], walk.days[: old - 1], past)
    return replace(every, speed=before.learnt().speed)


def _next(walk: Walk, new: Dated | None) -> tuple[State, float]:
    """Prior of the new session, and the factor by which a contradiction widens its covariance."""
    if new is None:
        usual = float(np.median(walk.days)) if len(walk.days) else 0.0
        return walk.later(usual), 1.0
    state = walk.expected[-1]
    square, degrees = state.surprise(walk.parts[-1])
    if chdtrc(degrees, square) > _ODD:
        return state, 1.0
    odd = square / degrees
    return State(state.value, odd * state.covariance), odd
