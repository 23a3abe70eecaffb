"""Sessions of one machine as linear evidence about the same parameters.

About its own fit each session k says

    r_k = X_k x_k + A_k z_k + noise

with x_k the machine at that time (dimensions and effects), z_k what belongs to the session alone:
the tracker's frame, the reflector's place on the platform, and what was found to act on readings
or by the session's own clock. With z_k integrated out nothing but information and its vector is
left of a session (`linear_model.py`), which is all that a comparison over months needs:

    H_k = X_k^T V_k^-1 X_k,    b_k = X_k^T V_k^-1 r_k

Sessions of few places are told of in `few.py`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Survey
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.diagnose import calibrated
from delta_calibration.diagnosis.geometry import without_geometry
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.model import Model
from delta_calibration.effects import Effect, Stage, catalogue
from delta_calibration.effects.base import SPREAD
from delta_calibration.history.walk import DIMENSION, Kept, Part
from delta_calibration.robot import Robot
from delta_calibration.threads import one_thread

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dated:
    """A session of a machine."""

    name: str  # its id in the history
    began: datetime
    survey: Survey
    effects: tuple[Effect, ...] = ()  # that its own diagnosis found


@dataclass(frozen=True)
class Said:
    """What a session says of all numbers of the machine, before it is judged what fits."""

    name: str
    information: Array  # (q, q) H
    right: Array  # (q,) b
    square: float  # r^T V^-1 r
    degrees: float  # of freedom of the residuals


@dataclass(frozen=True)
class Pool:
    """Sessions of one machine as linear evidence about the same numbers."""

    kept: tuple[Kept, ...]
    said: tuple[Said, ...]
    effects: tuple[Effect, ...]  # of the machine, in the order of `kept` behind its dimensions
    visit: tuple[Effect, ...]  # of single sessions

    @property
    def parts(self) -> tuple[Part, ...]:
        """Each session's information, less where even its own fit misses more than noise does."""
        return tuple(_believed(said, self.kept) for said in self.said)

    def only(self, causes: Collection[str]) -> Pool:
        """The same of the dimensions and of these effects, all others taken for nothing."""
        effects = tuple(effect for effect in self.effects if effect.cause in causes)
        here = np.array([k.spread == DIMENSION or k.what in causes for k in self.kept])
        rows = np.flatnonzero(here)
        said = tuple(
            replace(s, information=s.information[np.ix_(rows, rows)], right=s.right[rows])
            for s in self.said
        )
        return Pool(tuple(self.kept[row] for row in rows), said, effects, self.visit)


@one_thread()
def pool_whole(sessions: Sequence[Dated], robot: Robot, model: str | None = None) -> Pool:
    """What may change of the machine, and what each session says of it about its own fit.

    Args:
        sessions: in the order of time.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; the robot file's own where not given.

    Raises:
        DataError: a session has too few poses or is of another robot.
    """
    models = [calibrated(each.survey, robot, model) for each in sessions]
    machine, visit = _effects(sessions, models, robot)
    return Pool(
        _kept(models[0], machine),
        tuple(
            said_by(each.name, fitted, machine, visit)
            for each, fitted in zip(sessions, models, strict=True)
        ),
        tuple(machine),
        tuple(visit),
    )


def _effects(
    sessions: Sequence[Dated], models: Sequence[Model], robot: Robot
) -> tuple[list[Effect], list[Effect]]:
    """Effects of the machine, and those of single sessions that a diagnosis found.

    An effect that was found keeps the shape of the first session that found it.
    """
    every = {e.cause: e for e in catalogue(robot, models[0].bare.mechanism)}
    found = {e.cause: e for each in reversed(sessions) for e in each.effects}
    visit = [e for e in found.values() if _of_a_visit(e)]
    known = {cause: found.get(cause, effect) for cause, effect in every.items()}
    machine = [
        effect
        for effect in known.values()
        if not _of_a_visit(effect) and not any(effect.missing(m.evidence.at) for m in models)
    ]
    return machine, visit


def _of_a_visit(effect: Effect) -> bool:
    """Whether it is the tracker's or ends with the session: never a change of the machine."""
    return effect.stage is Stage.MEASUREMENT or effect.bound_to_session


def _kept(model: Model, effects: Sequence[Effect]) -> tuple[Kept, ...]:
    dimensions = [
        Kept(p.name, p.cause, p.location, p.unit, p.nominal, p.prior, DIMENSION, (p.name,))
        for p in model.bare.mechanism.parameters
    ]
    return (
        *dimensions,
        *(
            # sine and cosine of one joint are one thing
            Kept(p.name, e.cause, p.location, p.unit, 0.0, p.prior, SPREAD, (e.cause, p.location))
            for e in effects
            for p in e.parameters
        ),
    )


def _alone(
    model: Model, machine: Sequence[Effect], visit: Sequence[Effect]
) -> tuple[LinearizedModel, Array]:
    """A session's evidence with nothing but its own as nuisance, and the machine's columns."""
    evidence = model.evidence
    columns = np.concatenate(
        [evidence.geometry, *(evidence.columns(effect) for effect in machine)], axis=1
    )
    alone = without_geometry(evidence)
    for effect in visit:
        extra = evidence.columns(effect)
        alone = alone.beside(Plain(extra), np.full(extra.shape[1], SPREAD**-2.0))
    return alone, columns


def said_by(name: str, model: Model, machine: Sequence[Effect], visit: Sequence[Effect]) -> Said:
    """What a session says of the machine, about a fit of it.

    Args:
        name: of the session.
        model: the fit.
        machine: effects that the machine may have.
        visit: effects that were found to be of single sessions.
    """
    evidence, columns = _alone(model, machine, visit)
    weighed = evidence.weigh(evidence.column)[:, 0]
    square = float(evidence.column[:, 0] @ weighed)
    return Said(name, evidence.information(columns), columns.T @ weighed, square, evidence.degrees)


def _believed(said: Said, kept: Sequence[Kept]) -> Part:
    """The session's information, less where even its own fit misses more than noise explains."""
    information, right = said.information, said.right
    normal = information + np.diag([k.spread**-2.0 for k in kept])
    x = np.linalg.solve(normal, right)
    used = float(np.trace(np.linalg.solve(normal, information)))
    square = float(said.square - 2 * right @ x + x @ information @ x)
    misfit = max(1.0, square / max(said.degrees - used, 1.0))
    return Part(said.name, information / misfit, right / misfit, misfit)
