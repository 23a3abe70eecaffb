"""Whether one dimension of the machine stands out from all the others.

A machine's parts deviate by a common share tau of their tolerances, z ~ N(0, tau^2), tau found
from the data by marginal likelihood. A dimension that is out of line with that scatter, and that
makes up most of what geometry explains, is a cause by itself: many small deviations are what
calibration is for.

    -2 ln L(tau) = r'V0^-1 r - b'(G + tau^-2)^-1 b + ln det(1 + tau^2 G)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from delta_calibration.diagnosis.candidates import Candidate, dimensions
from delta_calibration.diagnosis.evidence import Evidence
from delta_calibration.diagnosis.scores import PRECISION

Array = NDArray[np.float64]

_SCATTERS = np.geomspace(0.01, 10.0, 61)
_MOST_OF = 0.5  # of what geometry explains


@dataclass(frozen=True)
class Outlier:
    """A dimension that stands out."""

    candidate: Candidate
    value: float  # in units of its tolerance
    information: float  # beside all other geometry at the machine's own scatter
    log_p: float  # times the number of dimensions
    log_bayes: float
    share: float  # of what geometry explains


@dataclass(frozen=True)
class Scatter:
    """How far the parts of this machine deviate from the drawing, as a share of the tolerances."""

    tau: float
    outlier: Outlier | None  # the most prominent dimension, significant or not


def scatter_of(evidence: Evidence) -> Scatter:
    """The machine's scatter, and the dimension that stands out most from it."""
    bare = without_geometry(evidence)
    columns = evidence.geometry
    information = bare.information(columns)
    b = (columns.T @ bare.weigh(bare.column))[:, 0]
    values, axes = np.linalg.eigh(information)
    values, along = np.clip(values, 0.0, None), axes.T @ b
    alone = _unlikeliness(values, along)
    best: tuple[float, int, int, float, float] | None = None
    for i, tau in enumerate(_SCATTERS):
        inverse = axes / (values + tau**-2) @ axes.T
        left = b - information @ (inverse @ b)
        own = np.diag(information) - np.einsum("ij,jk,ki->i", information, inverse, information)
        own = np.clip(own, 0.0, None)
        unlikely = alone[i] - left**2 / (own + PRECISION) + np.log1p(own / PRECISION)
        row = int(np.argmin(unlikely))
        if best is None or unlikely[row] < best[0]:
            best = float(unlikely[row]), i, row, float(own[row]), float(left[row])
    tau = float(_SCATTERS[int(np.argmin(alone))])
    if best is None:
        return Scatter(tau, None)
    least = float(alone.min())
    return Scatter(tau, _outlier(evidence, best, least, information, b, values, along))


def without_geometry(evidence: Evidence) -> Evidence:
    """The evidence of a machine whose dimensions are those of the drawing."""
    kept = slice(evidence.chain.geometry_size, None)
    return replace(
        evidence,
        nuisance=evidence.nuisance[:, :, kept],
        precision=evidence.precision[kept],
    )


def at_scatter(evidence: Evidence, tau: float) -> Evidence:
    """The evidence with dimensions that deviate by so much of their tolerances."""
    precision = evidence.precision.copy()
    precision[: evidence.chain.geometry_size] = tau**-2
    return replace(evidence, precision=precision)


def _unlikeliness(values: Array, along: Array) -> Array:
    """-2 ln L at each scatter, less what does not depend on it."""
    weaker = _SCATTERS[:, None] ** -2.0
    return np.asarray(
        -np.sum(along**2 / (values + weaker), axis=1) + np.sum(np.log1p(values / weaker), axis=1)
    )


def _outlier(
    evidence: Evidence,
    best: tuple[float, int, int, float, float],
    alone: float,
    information: Array,
    b: Array,
    values: Array,
    along: Array,
) -> Outlier:
    unlikely, _, row, own, left = best
    candidates = list(dimensions(evidence))
    price = float(np.log1p(own / PRECISION))
    ratio = alone - unlikely + price
    explained = float(np.sum(along**2 / (values + 1.0)))
    log_p = float(chi2.logsf(max(ratio, 0.0), 1)) + float(np.log(len(candidates)))
    return Outlier(
        candidate=candidates[row],
        value=left / (own + PRECISION),
        information=own,
        log_p=min(0.0, log_p),
        log_bayes=(alone - unlikely) / 2,
        share=float(b[row] ** 2 / information[row, row] / max(explained, 1e-300)),
    )
