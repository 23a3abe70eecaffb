"""Whether the machine's parts are what the drawing allows, and whether one of them stands out.

A machine's parts deviate by a common share tau of their tolerances, z ~ N(0, tau^2), tau found
from the data by marginal likelihood. A dimension that is out of line with that scatter, and that
makes up most of what geometry explains, is a cause by itself. Where none does but all scatter by
more than their tolerances, the geometry is; as long as they do not, they are what calibration is
for. A reflector that sits where nobody expects it is a cause in the same way.

    -2 ln L(tau) = r'V0^-1 r - b'(G + tau^-2)^-1 b + ln det(1 + tau^2 G)

A machine has few parts, so that tau is known by few degrees of freedom. A likelihood ratio is not
held against chi square, as it could be of many parts, but against what it is of nu normal numbers:
Student's t where one is out of line, chi square with nu degrees where all are large. With
e_i = (tau^2 + 1 / g_i)^-1, g_i and a_i being eigenvalues and vectors of G, they are as many as
the variance of that scatter and of noise is known by (Satterthwaite, Biometrics Bulletin 2 (1946)
110):

    nu = sum e_i^2 (sum a_ij^2 e_i)^2 / (sum a_ij^2 e_i^2)^2 - 1    beside part j
    nu = (sum e_i)^2 / sum e_i^2                                    of all
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import lambertw

from delta_calibration.diagnosis.candidates import Candidate, dimensions
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import PRECISION
from delta_calibration.diagnosis.tails import log_chi2, log_t
from delta_calibration.theta import entries

Array = NDArray[np.float64]

_SCATTERS = np.geomspace(0.01, 10.0, 61)
_MOST = 700.0  # whose exponential is a number
_SEEN = 1e-3  # of the prior's variance that the data must take away


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
    log_p: float  # of as much in a machine whose parts keep their tolerances
    outlier: Outlier | None  # the most prominent dimension, significant or not


def scatter_of(evidence: LinearizedModel) -> Scatter:
    """The machine's scatter, and the dimension that stands out most from it."""
    bare = without_geometry(evidence)
    columns = evidence.geometry
    information = bare.information(columns)
    b = (columns.T @ bare.weigh(bare.column))[:, 0]
    values, axes = np.linalg.eigh(information)
    values, along = np.clip(values, 0.0, None), axes.T @ b
    alone = _unlikeliness(values, along, _SCATTERS)
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
    tau, least = float(_SCATTERS[int(np.argmin(alone))]), float(alone.min())
    within = float(_unlikeliness(values, along, np.ones(1))[0])
    log_p = _log_p_of_size(within - least, values / (1 + values)) if tau > 1 else 0.0
    if best is None:
        return Scatter(tau, log_p, None)
    return Scatter(tau, log_p, _outlier(evidence, best, least, information, b, values, axes))


def _degrees_beside(values: Array, tau: float, share: Array) -> float:
    """Degrees of freedom of the scatter that a part is held against; not fewer than one.

    Args:
        values: eigenvalues of the information about the parts, in units of their tolerances, (p,).
        tau: scatter of the parts.
        share: of the part in each eigenvector, squared, (p,).
    """
    each = values / (1.0 + values * tau**2)
    moved = float(share @ each**2)
    if moved <= 0:
        return 1.0
    return max(1.0, float(each @ each) * float(share @ each) ** 2 / moved**2 - 1.0)


def _log_p_of_size(ratio: float, each: Array) -> float:
    """ln p of numbers as much larger than they may be, by a likelihood ratio (of -2 ln L).

    Of n numbers whose mean square is s times what it may be, ratio = n (s - 1 - ln s).

    Args:
        ratio: of the likelihoods.
        each: what tells of the scatter, (p,).
    """
    degrees = each.sum() ** 2 / (each @ each)
    size = -lambertw(-np.exp(-1.0 - max(ratio, 0.0) / degrees), -1).real
    return float(log_chi2(degrees * size, degrees))


def _log_p_of_one(ratio: float, degrees: float) -> float:
    """ln p of a number as far out of line with the others, by a likelihood ratio.

    Of n others, ratio = (n + 1) ln(1 + t^2 / n).
    """
    square = degrees * np.expm1(np.clip(ratio / (degrees + 1), 0.0, _MOST))
    return float(np.log(2) + log_t(np.sqrt(square), degrees))


def displaced(evidence: LinearizedModel) -> float:
    """ln p of a reflector as far from where it is said to be, as its prior allows."""
    rows = offset_rows(evidence)
    z, known = evidence.best()[rows], evidence.covariance()[np.ix_(rows, rows)]
    spread = np.eye(len(rows)) - known  # of the most likely values, where z ~ N(0, 1)
    values, axes = np.linalg.eigh(spread)
    seen = values > _SEEN
    square = float(np.sum((axes[:, seen].T @ z) ** 2 / values[seen]))
    return float(log_chi2(square, max(int(seen.sum()), 1)))


def offset_rows(evidence: LinearizedModel) -> NDArray[np.int64]:
    """Entries of the nuisance that are the reflector's offset, (3,)."""
    return entries(evidence.chain.layout.offset)


def without(evidence: LinearizedModel, rows: NDArray[np.int64]) -> LinearizedModel:
    """The evidence with some of the nuisance as the drawing has it."""
    kept = np.setdiff1d(np.arange(evidence.nuisance.shape[2]), rows)
    precision = np.delete(evidence.precision, rows)
    return replace(evidence, nuisance=evidence.nuisance[:, :, kept], precision=precision)


def without_geometry(evidence: LinearizedModel) -> LinearizedModel:
    """The evidence of a machine whose dimensions are those of the drawing."""
    return without(evidence, entries(evidence.chain.layout.geometry))


def as_known(placed: Fitted) -> LinearizedModel:
    """The evidence of a machine that is as it is known, where it is placed being open.

    Args:
        placed: what `Fitted.registered` gives.
    """
    return without(placed.evidence, placed.unplaced)


def at_scatter(evidence: LinearizedModel, tau: float) -> LinearizedModel:
    """The evidence with dimensions that deviate by so much of their tolerances."""
    precision = evidence.precision.copy()
    precision[evidence.chain.layout.geometry] = tau**-2
    return replace(evidence, precision=precision)


def _unlikeliness(values: Array, along: Array, scatters: Array) -> Array:
    """-2 ln L at each scatter, less what does not depend on it."""
    weaker = scatters[:, None] ** -2.0
    return np.asarray(
        -np.sum(along**2 / (values + weaker), axis=1) + np.sum(np.log1p(values / weaker), axis=1)
    )


def _outlier(
    evidence: LinearizedModel,
    best: tuple[float, int, int, float, float],
    alone: float,
    information: Array,
    b: Array,
    values: Array,
    axes: Array,
) -> Outlier:
    unlikely, i, row, own, left = best
    candidates = list(dimensions(evidence))
    price = float(np.log1p(own / PRECISION))
    ratio = alone - unlikely + price
    explained = float(np.sum((axes.T @ b) ** 2 / (values + 1.0)))
    degrees = _degrees_beside(values, float(_SCATTERS[i]), axes[row] ** 2)
    log_p = _log_p_of_one(ratio, degrees) + float(np.log(len(candidates)))
    seen = float(information[row, row])
    return Outlier(
        candidate=candidates[row],
        value=left / (own + PRECISION),
        information=own,
        log_p=min(0.0, log_p),
        log_bayes=(alone - unlikely) / 2,
        share=float(b[row] ** 2 / seen / max(explained, 1e-300)) if seen > 0 else 0.0,
    )
