"""The extended calibration of a diagnosis, in the form of a fit's result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.fitted import beside, without_effects
from delta_calibration.diagnosis.geometry import as_known
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.model import Model
from delta_calibration.diagnosis.open_shapes import OpenShape, open_shape
from delta_calibration.estimation import (
    DIAGNOSIS,
    Effort,
    Identification,
    Missed,
    Residuals,
    Rest,
    observe,
    parts_of,
    residuals_of,
    strong_correlations,
    studentized,
    told_by,
    uncertainty_of,
)
from delta_calibration.region import Region
from delta_calibration.theta import entries

Array = NDArray[np.float64]


def extended(model: Model, seed: int) -> Identification:
    """Identified geometry, frame and effects of the terms, with their covariance.

    Args:
        model: the machine with its terms.
        seed: seed of the diagnosis, and of the parts held out for the error left.
    """
    problem, poses, before = model.extended, model.survey.poses, model.registered()
    chain, base = problem.chain, model.problem.chain
    geometry, frame = base.mechanism.parameters.nominal, chain.split(model.chain_theta)[2]
    own = model.layout.chain
    covariance = covariance_of(model)[np.ix_(own, own)]
    drawing = model.theta[model.layout.base].copy()
    drawing[model.problem.layout.chain] = base.join(geometry, base.offset, frame)
    unscaled = replace(model.problem, basis=np.eye(len(drawing)))
    nominal = base.mechanism.forward(poses.joint, geometry)
    # placed by the poses alone, as in a fit: both state the same error before
    drawn, beside = as_known(before).take(np.arange(len(poses))), model.beside
    missed_before, missed = (_held_out(e, model, seed) for e in (drawn, beside))
    return Identification(
        chain=chain,
        theta=model.chain_theta,
        covariance=covariance,
        noise=model.cell.noise,
        observability=observe(
            unscaled.linearized(drawing).slope, np.diag(model.problem.basis), model.problem.names
        ),
        correlations=strong_correlations(
            covariance[base.layout.base, base.layout.base], base.parameters.names
        ),
        frame_only=_residuals(drawn, missed_before, model),
        full=_residuals(beside, missed, model),
        frame_only_theta=without_effects(before.theta, model.layout)[own],
        weight=model.cell.weight,
        chi_square=model.misfit,
        region=Region.of(base.mechanism.position(nominal)),
        region_joints=(poses.joint.min(axis=0), poses.joint.max(axis=0)),
        seed=seed,
        effort=Effort(DIAGNOSIS, settings=told_by(population=model.population)),
        missed_before=missed_before,
        missed=missed,
        uncertainty=uncertainty_of(
            chain,
            model.chain_theta,
            covariance_of(model, shapes=False)[np.ix_(own, own)],
            Rest(model.cell.noise.repeatability, model.cell.noise.freedom),
            _missed(beside, model),
        ),
        unseen_motion=poses.unseen_motion,
    )


def covariance_of(model: Model, shapes: bool = True) -> Array:
    """Covariance of theta given data and priors, (P, P); zero for entries that are not free.

    Args:
        model: the machine with its terms.
        shapes: whether to include the uncertainty of the effects' searched fields (a frequency, a
            time constant), as in a parameter's interval. The uncertainty of a position leaves it
            out: an amplitude follows its frequency, and at the measured places both together are
            wrong by less than either.
    """
    evidence, problem = model.beside, model.extended
    searched = model.terms if shapes else ()
    misfit = max(1.0, model.misfit)
    left = [_left_open(model, m, misfit) for m in searched]
    opened = np.concatenate([np.zeros((evidence.size, 0)), *(o.columns for o in left)], axis=1)
    sure = np.concatenate([np.zeros(0), *(o.precision for o in left)])
    known = evidence.beside(Plain(opened), sure * misfit)
    size = len(evidence.precision)
    base, layout = model.layout.base, model.column_layout
    whole = np.zeros((model.layout.size, layout.size))
    whole[base, base] = problem.basis[base, base]
    for term, own, part in zip(model.terms, model.layout.each, layout.each, strict=True):
        rows, columns = np.array(term.rows), entries(part)
        if term.effect is None:
            whole[rows, columns] += np.diag(problem.basis)[rows]
        else:
            whole[entries(own)[rows], columns] = term.effect.parameters.prior[rows]
    spread = known.covariance()[:size, :size]
    return np.asarray(whole @ spread @ whole.T * misfit)


def _left_open(model: Model, term: Candidate, misfit: float) -> OpenShape:
    """Uncertainty of the searched fields of a term's shape, beside the other terms."""
    others = tuple(m for m in model.terms if m is not term)
    return open_shape(term, beside(model.evidence, others), model.scaled(term), misfit)


def _held_out(evidence: LinearizedModel, model: Model, seed: int) -> Array:
    """Measured less predicted by a fit to the other parts and all motions, (n, 3) [m].

    Linearized about the fit, as all of a diagnosis. NaN rows for poses that do not count.
    """
    part = parts_of(model.survey.poses, seed)
    rows, misfit = _counted(evidence), evidence.misfit
    missed = np.full((evidence.poses, 3), np.nan)
    for number in np.unique(part[rows]):
        own = rows[part[rows] == number]
        best = evidence.but(np.flatnonzero(part == number)).best(misfit)
        missed[own] = evidence.take(own).missed(best)
    return missed


def _missed(evidence: LinearizedModel, model: Model) -> Missed:
    """Studentized residuals of the poses that count, as if the fit had absorbed none of them."""
    poses, rows = model.survey.poses, _counted(evidence)
    root = np.sqrt(max(1.0, evidence.misfit))
    residual = evidence.residual[rows] / root
    columns = evidence.possible.part(rows, evidence.coordinates)
    slope = columns.dense.reshape(*residual.shape, -1) / root
    found = studentized(evidence.known(root**2), slope, residual, poses.place[rows])
    colour = root * np.linalg.inv(evidence.whiten[rows, :3, :3])
    return Missed(
        poses.conditions.take(rows),
        (colour @ found[:, :3, None])[..., 0],
        model.problem.whiten[rows, :3, :3],
        poses.place[rows],
    )


def _counted(evidence: LinearizedModel) -> NDArray[np.intp]:
    return np.flatnonzero(evidence.believed[: evidence.poses])


def _residuals(evidence: LinearizedModel, missed: Array, model: Model) -> Residuals:
    """Residual figures as defined for a fit, over the same poses in the same parts."""
    rows = _counted(evidence)
    fitted = evidence.missed(evidence.best(evidence.misfit))[rows]
    whiten = model.problem.whiten[rows, :3, :3]
    return residuals_of(np.linalg.norm(fitted, axis=1), missed[rows], whiten)
