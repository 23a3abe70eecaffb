"""The calibration that a diagnosis extends the model to, in the form that a fit gives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.evidence import Evidence
from delta_calibration.diagnosis.findings import HeldOutModels
from delta_calibration.diagnosis.geometry import without_geometry
from delta_calibration.diagnosis.model import Model
from delta_calibration.identification import (
    Effort,
    Identification,
    Residuals,
    observe,
    strong_correlations,
)
from delta_calibration.region import Region

Array = NDArray[np.float64]


def extended(model: Model, held: HeldOutModels, seed: int) -> Identification:
    """Geometry, frame and the members' effects with their covariance.

    Args:
        model: the machine with its members.
        held: its held-out errors.
        seed: of the diagnosis.
    """
    problem, poses = model.extended, model.survey.poses
    chain, base, at = problem.chain, model.problem.chain, poses.conditions
    covariance = covariance_of(model)
    geometry, frame = base.mechanism.parameters.nominal, chain.split(model.theta)[2]
    drawing = base.join(geometry, base.offset, frame)
    jacobian = base.jacobian(at, base.pose(at, drawing), drawing)
    nominal = base.mechanism.forward(poses.joint, geometry)
    return Identification(
        chain=chain,
        theta=model.theta,
        covariance=covariance,
        noise=model.cell.noise,
        observability=observe(
            problem.whiten @ jacobian, np.diag(model.problem.basis), base.parameters.names
        ),
        correlations=strong_correlations(
            covariance[: base.base_size, : base.base_size], base.parameters.names
        ),
        frame_only=_residuals(without_geometry(model.evidence), held, held.frame.square),
        full=_residuals(
            model.beside, held, held.members(model.members, held.sectors).square
        ),
        frame_only_theta=problem.theta0,
        weight=model.cell.weight,
        chi_square=model.misfit,
        region=Region.of(base.mechanism.position(nominal)),
        region_joints=(poses.joint.min(axis=0), poses.joint.max(axis=0)),
        seed=seed,
        effort=Effort("diagnosis"),
    )


def covariance_of(model: Model) -> Array:
    """Covariance of theta given data and priors, (P, P); of what is not free it is zero."""
    evidence, problem = model.beside, model.extended
    base, sizes = problem.chain.base_size, [len(m.rows) for m in model.members]
    whole = np.zeros((len(model.theta), len(evidence.precision)))
    whole[:base, :base] = problem.basis[:base, :base]
    column, begin = len(evidence.precision) - sum(sizes), base
    for member, size in zip(model.members, sizes, strict=True):
        rows = np.array(member.rows)
        columns = column + np.arange(size)
        if member.effect is None:
            whole[rows, columns] += np.diag(problem.basis)[rows]
        else:
            whole[begin + rows, columns] = member.effect.parameters.prior[rows]
            begin += len(member.effect.parameters)
        column += size
    return np.asarray(whole @ evidence.covariance() @ whole.T * max(1.0, model.misfit))


def _residuals(evidence: Evidence, held: HeldOutModels, square: Array) -> Residuals:
    rows = held.poses
    missed = evidence.missed(evidence.best(evidence.misfit))[rows]
    size = float(np.mean(square[rows]))
    return Residuals(
        in_sample=float(np.sqrt(np.mean(np.sum(missed**2, axis=1)))),
        held_out=float(np.sqrt(size)),
        held_out_max=float(np.sqrt(square[rows].max())),
        held_out_whitened=float(np.sqrt(size / np.mean(held.evidence.variance[rows]))),
    )
