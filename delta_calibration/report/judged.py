"""Common data of a diagnosis' figures: held-out errors of each pose by the three models."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions, at_rest
from delta_calibration.diagnosis.candidates import Candidate, moved_by
from delta_calibration.diagnosis.diagnose import Diagnosis
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.region import Region

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class Judged:
    """Diagnosis with the data for its figures; first axis of the errors: the accepted pose."""

    diagnosis: Diagnosis
    rows: Index  # (n,) rows of the evidence
    place: Array  # (n, 3) [m] platform's centre in the base
    before: Array  # (n,) [m] held-out 3-D error of each pose, by the model before
    calibrated: Array  # (n,) [m]
    extended: Array  # (n,) [m]

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Judged:
        """Compute the data from a diagnosis."""
        held, evidence = diagnosis.held, diagnosis.held.evidence
        rows = np.flatnonzero(held.poses)
        models = [diagnosis.before, held.terms((), held.sectors), diagnosis.after]
        before, calibrated, extended = (np.sqrt(model.square[rows]) for model in models)
        place = evidence.chain.mechanism.position(evidence.pose[rows])
        return cls(diagnosis, rows, place, before, calibrated, extended)

    @property
    def evidence(self) -> LinearizedModel:
        """Model linearised about the extended model."""
        return self.diagnosis.held.evidence

    @property
    def region(self) -> Region:
        """Convex hull of the measured poses."""
        return self.diagnosis.identification.region

    @property
    def calibrated_theta(self) -> Array:
        """Linear estimate of geometry, offset and frame without the terms, (P,) of the chain."""
        problem, evidence = self.diagnosis.model.problem, self.evidence
        z = evidence.best(evidence.misfit)
        base = problem.chain.layout.base
        return np.asarray(problem.theta0[base] + problem.basis[base, base] @ z[base])

    def usual(self, joint: Array, direction: float) -> Conditions:
        """Conditions of joints (n, m) [rad] at rest, all approached from one side.

        Payload, temperatures and time are the medians of the session.
        """
        at, seen = at_rest(joint), self.diagnosis.model.survey.poses
        n = len(joint)
        medians = np.median(seen.temperature, axis=0) if len(seen.temperature_parts) else ()
        return replace(
            at,
            time=np.full(n, np.median(seen.time)),
            direction=np.full(joint.shape, direction),
            payload=np.full(n, np.median(seen.payload)),
            payload_centre=np.tile(np.median(seen.payload_centre, axis=0), (n, 1)),
            temperature_parts=seen.temperature_parts,
            temperature=np.tile(medians, (n, 1)).reshape(n, -1),
        )

    def moved_by(self, term: Candidate, rows: Index) -> Array:
        """Displacement of the readings by a term, (n, 3) [m] in the tracker's frame."""
        evidence = self.evidence
        best = self.diagnosis.model.values(term) / _priors(term, self.diagnosis)
        whitened = moved_by(term, evidence, best).reshape(evidence.residual.shape)
        return evidence.metres(whitened[rows], rows)

    def left(self) -> Array:
        """Residuals of the extended model, (all, 3) [m]; NaN for readings set aside."""
        beside = self.diagnosis.model.beside
        return beside.missed(beside.best(beside.misfit))

    def beside_term(self, term: Candidate, rows: Index) -> Array:
        """Residuals with all terms but one in the model, (n, 3) [m]."""
        return np.asarray(self.left()[rows] + self.moved_by(term, rows))


def _priors(term: Candidate, diagnosis: Diagnosis) -> Array:
    """Prior standard deviations by which the columns of a term are scaled, (k,)."""
    chain = diagnosis.model.problem.chain
    items = (
        chain.mechanism.parameters.items if term.effect is None else (term.effect.parameters.items)
    )
    return np.array([items[row].prior for row in term.rows])
