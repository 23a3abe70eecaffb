"""How well some samples distinguish two candidate causes.

With G the information matrix of their parameters after projecting out geometry and frame, and v
the parameters of the first at a typical size,

    lambda = E v' (G_11 - G_12 (G_22 + L)^-1 G_21) v        cos^2 = 1 - lambda / E v' G_11 v

lambda is the part of the signal that the second cannot imitate, cos the part that it can: 1 if
both change the samples in the same way. L is the prior precision of the second's parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate, columns_of
from delta_calibration.diagnosis.constants import NAMED, SAME
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.predicted_information import Mask, Products
from delta_calibration.diagnosis.scores import PRECISION

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contrast:
    """How well two candidates can be distinguished."""

    cosine: float
    signal: float  # lambda of the first after projecting out the second

    @property
    def parted(self) -> bool:
        """Whether the first, of typical size, would be distinguished from the second."""
        return self.cosine < SAME and self.signal >= NAMED


@dataclass(frozen=True)
class Pair:
    """Two candidates to distinguish; a second of None stands for the geometry alone."""

    first: Candidate
    second: Candidate | None

    @property
    def outside(self) -> str:
        """What would separate them that no motion of the cell can; empty if nothing is known."""
        effects = (c.effect for c in (self.first, self.second) if c is not None)
        known = (effect.outside for effect in effects if effect is not None and effect.outside)
        return next(known, "")

    def nuisance(self, size: int) -> Mask:
        """Mask of the nuisance parameters among the unknowns that all samples share, (size,)."""
        nuisance = np.ones(size, dtype=bool)
        for candidate in (self.first, self.second):
            if candidate is not None and candidate.effect is None:
                nuisance[list(candidate.rows)] = False
        return nuisance

    def columns(self, evidence: LinearizedModel) -> Array:
        """Whitened columns of both side by side, (d n, k)."""
        both = [self.first] if self.second is None else [self.first, self.second]
        return np.concatenate([columns_of(c, evidence) for c in both], axis=1)

    def products(self, evidence: LinearizedModel) -> Products:
        """Inner products of the columns of both candidates."""
        return Products.of(evidence, self.columns(evidence))

    def contrast(self, products: Products, precision: Array, geometry: slice) -> Contrast:
        """Contrast of the pair for samples with these inner products.

        Args:
            products: inner products of this pair, over any samples.
            precision: prior precision of the unknowns that the samples share, (s,).
            geometry: which of those are the mechanism's dimensions.
        """
        alone, left = self.signals(products, precision, geometry)
        if alone <= 0:
            return Contrast(1.0, 0.0)
        return Contrast(float(np.sqrt(np.clip(1 - left / alone, 0, 1))), max(left, 0.0))

    def signals(
        self, products: Products, precision: Array, geometry: slice
    ) -> tuple[float, float]:
        """Signal (lambda) of the first by itself, and after projecting out the second."""
        nuisance = self.nuisance(len(precision))
        k = len(self.first.rows)
        information = products.information(precision, nuisance)
        alone = left = information[:k, :k]
        if self.second is None:
            nuisance[geometry] = False
            alone = products.information(precision, nuisance)
        else:
            across = information[:k, k:]
            other = information[k:, k:] + PRECISION * np.eye(len(information) - k)
            left = left - across @ np.linalg.solve(other, across.T)
        typical = _typical(self.first)
        return float(np.sum(typical * alone)), float(np.sum(typical * left))


def _typical(candidate: Candidate) -> Array:
    """E v v' of parameters at their prior, of either sign unless bounded below by 0, (k, k)."""
    mean = np.zeros(len(candidate.rows))
    if candidate.effect is not None:
        items = candidate.effect.parameters.items
        mean[:] = [items[row].lower == 0 for row in candidate.rows]
    return np.asarray(np.outer(mean, mean) + np.diag(1 - mean))
