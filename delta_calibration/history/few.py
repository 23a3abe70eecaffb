"""Sessions with few places, combined with full sessions of the same machine.

A fit to few poses may end far from the true parameters, where the linearised model does not hold.
So such a session is linearised about a fit that has a wide prior of the dimensions from the other
sessions. Only the likelihood of its own readings is added (`pooled.py`), so the evidence of
another session is never counted twice.
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

_FAST = 0.3  # [typical sizes / sqrt(day)] assumed fast drift, for the wide prior


def places_of(survey: Survey) -> int:
    """Number of different places at which a session has poses at rest."""
    return len(np.unique(survey.poses.place))


def is_few(survey: Survey) -> bool:
    """Whether a session has too few places to be fitted by itself."""
    return places_of(survey) < FEWEST


@one_thread()
def pool(sessions: Sequence[Dated], robot: Robot, model: str | None = None) -> Pool:
    """Collect the parameters that may change, and each session's linear evidence about them.

    Args:
        sessions: in order of time; at least one has enough places for a fit by itself.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; by default the robot file's own.

    Raises:
        DataError: no session has enough places, or one has too few even for a fit with a prior or
            is of another robot.
    """
    order = sorted(range(len(sessions)), key=lambda number: is_few(sessions[number].survey))
    done = [sessions[number] for number in order if not is_few(sessions[number].survey)]
    if not done:
        raise DataError(
            f"no session has {FEWEST} or more places; the machine must be measured in full once"
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
    """Add one more session, which may have few places, to a pool.

    Args:
        past: evidence of other sessions.
        done: these other sessions, in the order of `past`.
        new: session to be added.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; by default the robot file's own.

    Raises:
        DataError: the session has too few places or is of another robot.
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
    """Linearise each session again, about a fit with a wide prior from the other sessions.

    A fit to one session alone is wrong along its weakly identifiable directions, and by what its
    effects distort. Together the sessions are precise enough for these errors to matter.

    Args:
        past: evidence of the sessions, each linearised about its own fit.
        sessions: in the order of `past`.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; by default the robot file's own.
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
    """Turn a state in typical sizes into the prior of a fit, in the parameters' own units.

    Args:
        past: pool whose parameters the state has.
        state: mean and covariance of these parameters.
        done: sessions that they were estimated from.
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
    """Wide prior of a machine that may have changed much since it was last measured.

    It uses the sessions before the new one or, if there are none, the later ones, latest first.
    """
    began, parts = [each.began.timestamp() for each in done], past.parts
    times = np.array(began) - new.began.timestamp()
    there = np.flatnonzero(times <= 0) if (times <= 0).any() else np.arange(len(times))
    there = there[np.argsort(-np.abs(times[there]), kind="stable")]
    days = np.abs(days_between([*times[there].tolist(), 0.0]))
    speed = tuple((kept.what, _FAST) for kept in past.kept)
    walk = Walk(past.kept, tuple(parts[int(k)] for k in there), days[:-1], speed=speed)
    return carried_of(past, walk.later(float(days[-1])), [done[int(k)] for k in there])
