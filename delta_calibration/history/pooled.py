"""Sessions of one machine as linear evidence about the same parameters.

Linearised about its own fit, the residuals of session k are

    r_k = X_k x_k + A_k z_k + noise

with x_k the parameters of the machine at that time (dimensions and effects) and z_k the nuisance
parameters of the session: the tracker's frame, the reflector's offset, and effects that were found
to act on readings or by the session's own clock. With z_k integrated out, an information matrix
and a vector remain of a session (`linear_model.py`), all that a comparison over months needs:

    H_k = X_k^T V_k^-1 X_k,    b_k = X_k^T V_k^-1 r_k

Sessions with few places are handled in `few.py`.
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
    """A session of a machine with its start time."""

    name: str  # its id in the history
    began: datetime
    survey: Survey
    effects: tuple[Effect, ...] = ()  # found by its own diagnosis

    @property
    def causes(self) -> frozenset[str]:
        """Causes that its own diagnosis found."""
        return frozenset(effect.cause for effect in self.effects)


@dataclass(frozen=True)
class Said:
    """Evidence of a session about all parameters of the machine, before its misfit is judged."""

    name: str
    information: Array  # (q, q) H
    right: Array  # (q,) b
    square: float  # r^T V^-1 r
    degrees: float  # degrees of freedom of the residuals


@dataclass(frozen=True)
class Pool:
    """Evidence of several sessions about the same parameters of one machine."""

    kept: tuple[Kept, ...]
    said: tuple[Said, ...]
    effects: tuple[Effect, ...]  # of the machine, in the order of `kept` after the dimensions
    visit: tuple[Effect, ...]  # nuisance effects of single sessions

    @property
    def parts(self) -> tuple[Part, ...]:
        """Each session's evidence, scaled down if even its own fit exceeds the noise."""
        return tuple(_believed(said, self.kept) for said in self.said)

    def only(self, causes: Collection[str]) -> Pool:
        """The pool with the dimensions and these effects only; all other effects are set to 0."""
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
    """Collect the parameters that may change, and each session's evidence about its own fit.

    Args:
        sessions: in order of time.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; by default the robot file's own.

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
    """List the effects of the machine, and those of single sessions that a diagnosis found.

    A found effect has the shape from the first session that found it, or its shapes if it was
    found more than once in that session.
    """
    found: dict[str, list[Effect]] = {}
    for each in reversed(sessions):
        found |= {
            cause: [e for e in each.effects if e.cause == cause]
            for cause in dict.fromkeys(e.cause for e in each.effects)
        }
    visit = [e for shapes in found.values() for e in shapes if _of_a_visit(e)]
    machine = [
        shape
        for effect in catalogue(robot, models[0].bare.mechanism)
        for shape in found.get(effect.cause, [effect])
        if not _of_a_visit(shape) and not any(shape.missing(m.evidence.at) for m in models)
    ]
    return machine, visit


def _of_a_visit(effect: Effect) -> bool:
    """Whether an effect is the tracker's or goes by the clock: each session has its own."""
    return effect.stage is Stage.MEASUREMENT or effect.bound_to_session


def _kept(model: Model, effects: Sequence[Effect]) -> tuple[Kept, ...]:
    dimensions = [
        Kept(p.name, p.cause, p.location, p.unit, p.nominal, p.prior, DIMENSION, (p.name,))
        for p in model.bare.mechanism.parameters
    ]
    return (
        *dimensions,
        *(
            # one group for an effect at one location, such as the sine and cosine of a joint
            Kept(
                p.name,
                e.cause,
                p.location,
                p.unit,
                0.0,
                p.prior,
                SPREAD,
                (e.cause, p.location, str(number)),
            )
            for number, e in enumerate(effects)
            for p in e.parameters
        ),
    )


def _alone(
    model: Model, machine: Sequence[Effect], visit: Sequence[Effect]
) -> tuple[LinearizedModel, Array]:
    """Linear model with the session's own nuisance parameters, and the machine's columns."""
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
    """Compute a session's evidence about the machine, linearised about a fit.

    Args:
        name: id of the session.
        model: the fit.
        machine: effects that the machine may have.
        visit: effects of single sessions, as nuisance parameters.
    """
    evidence, columns = _alone(model, machine, visit)
    weighed = evidence.weigh(evidence.column)[:, 0]
    square = float(evidence.column[:, 0] @ weighed)
    return Said(name, evidence.information(columns), columns.T @ weighed, square, evidence.degrees)


def _believed(said: Said, kept: Sequence[Kept]) -> Part:
    """A session's evidence, divided by the reduced chi square of its own fit if that exceeds 1."""
    information, right = said.information, said.right
    normal = information + np.diag([k.spread**-2.0 for k in kept])
    x = np.linalg.solve(normal, right)
    used = float(np.trace(np.linalg.solve(normal, information)))
    square = float(said.square - 2 * right @ x + x @ information @ x)
    misfit = max(1.0, square / max(said.degrees - used, 1.0))
    return Part(said.name, information / misfit, right / misfit, misfit)
