"""Sessions of few places beside whole ones, as evidence about the same machine.

A fit to few poses may end far from the machine, where nothing is linear that holds near it. Such
a session is taken about a fit that knows roughly what the other sessions say of the dimensions. It
adds what its own readings say and nothing else (`pooled.py`): however it was fitted, nothing of
another session is counted with it a second time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from delta_calibration.data import Survey
from delta_calibration.diagnosis import FEWEST, calibrated
from delta_calibration.errors import DataError
from delta_calibration.estimation import FEWEST_CARRIED, Carried, solve
from delta_calibration.history.pooled import Dated, Pool, pool_whole, said_by
from delta_calibration.history.walk import State, Walk, days_between
from delta_calibration.robot import Robot
from delta_calibration.threads import one_thread

_FAST = 0.3  # [typical sizes / sqrt(day)] as if a machine drifted


def places_of(survey: Survey) -> int:
    """How many different places a session has poses at rest in."""
    return len(np.unique(survey.poses.place))


def is_few(survey: Survey) -> bool:
    """Whether a session has too few places to be fitted by itself."""
    return places_of(survey) < FEWEST


@one_thread()
def pool(sessions: Sequence[Dated], robot: Robot, model: str | None = None) -> Pool:
    """What may change of the machine, and what each session says of it.

    Args:
        sessions: in the order of time; one at least has enough places for a fit by itself.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; the robot file's own where not given.

    Raises:
        DataError: no session has enough places, one has hardly any, or is of another robot.
    """
    order = sorted(range(len(sessions)), key=lambda number: is_few(sessions[number].survey))
    done = [sessions[number] for number in order if not is_few(sessions[number].survey)]
    if not done:
        raise DataError(
            f"no session has {FEWEST} or more places; a machine has to be measured whole once"
        )
    found = pool_whole(done, robot, model)
    for number in order[len(done) :]:
        found = pool_with(found, done, sessions[number], robot, model)
        done.append(sessions[number])
    place = np.argsort(order)
    return replace(found, said=tuple(found.said[int(k)] for k in place))


@one_thread()
def pool_with(
    past: Pool, done: Sequence[Dated], new: Dated, robot: Robot, model: str | None = None
) -> Pool:
    """The same with one more session, which may have few places.

    Args:
        past: what other sessions say.
        done: these sessions, in the order of `past`.
        new: the session.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; the robot file's own where not given.

    Raises:
        DataError: it has too few places or is of another robot.
    """
    alone = calibrated(new.survey, robot, model, FEWEST_CARRIED)
    near = solve(_roughly(past, done, new).bare.applied(alone.problem))
    about = replace(
        alone, theta=near.theta, cell=replace(alone.cell, weight=near.weight), near=None
    )
    at = about.evidence.at
    able = past.only([effect.cause for effect in past.effects if not effect.missing(at)])
    said = said_by(new.name, about, able.effects, able.visit)
    return replace(able, said=(*able.said, said))


def pool_near(
    past: Pool, sessions: Sequence[Dated], robot: Robot, model: str | None = None
) -> Pool:
    """The same, each session taken about a fit that knows roughly what the others say.

    A fit of one session by itself is off the machine along what that session hardly shows, and by
    what its effects bend; together the sessions are sure enough for that to count.

    Args:
        past: what the sessions say, each about its own fit.
        sessions: in the order of `past`.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; the robot file's own where not given.
    """
    if len(sessions) < 2:
        return past
    said = []
    for number, session in enumerate(sessions):
        rest = [k for k in range(len(sessions)) if k != number]
        others = replace(past, said=tuple(past.said[k] for k in rest))
        near = pool_with(others, [sessions[k] for k in rest], session, robot, model)
        said.append(near.said[-1])
    return replace(past, said=tuple(said))


def carried_of(past: Pool, state: State, done: Sequence[Dated]) -> Carried:
    """What is known of a machine, as a fit takes it.

    Args:
        past: whose numbers the state has.
        state: what is known of them.
        done: the sessions that say it.
    """
    scale = np.array([kept.scale for kept in past.kept])
    nominal = np.array([kept.nominal for kept in past.kept])
    return Carried(
        past.effects,
        nominal + scale * state.value,
        scale[:, None] * state.covariance * scale,
        np.concatenate([each.survey.poses.joint for each in done]),
        tuple(each.name for each in done),
    )


def _roughly(past: Pool, done: Sequence[Dated], new: Dated) -> Carried:
    """What is known of a machine that may have changed much since it was measured last.

    By the sessions before the new one; those behind it, the latest first, where there are none.
    """
    began, parts = [each.began.timestamp() for each in done], past.parts
    times = np.array(began) - new.began.timestamp()
    there = np.flatnonzero(times <= 0) if (times <= 0).any() else np.arange(len(times))
    there = there[np.argsort(-np.abs(times[there]), kind="stable")]
    days = np.abs(days_between([*times[there].tolist(), 0.0]))
    speed = tuple((kept.what, _FAST) for kept in past.kept)
    walk = Walk(past.kept, tuple(parts[int(k)] for k in there), days[:-1], speed=speed)
    return carried_of(past, walk.later(float(days[-1])), [done[int(k)] for k in there])
