"""Test whether the machine's dimensions keep their tolerances, and whether one is an outlier.

The dimensions of a machine deviate by a common share tau of their tolerances, z ~ N(0, tau^2);
tau is estimated from the data by marginal likelihood. A dimension that is an outlier to that
scatter and makes up a quarter of what geometry explains is a cause by itself. If there is none,
but all scatter by more than their tolerances, the geometry is a cause; smaller deviations are what
calibration is for. A reflector whose offset is unlikely under its prior is a cause as well.

    -2 ln L(tau) = r'V0^-1 r - b'(G + tau^-2)^-1 b + ln det(1 + tau^2 G)

A machine has few dimensions, so that tau is known with few degrees of freedom nu. A likelihood
ratio is therefore not compared with the chi square of many dimensions, but with its distribution
for nu normal numbers: Student's t for one outlier, chi square with nu degrees if all are large.
With e_i = (tau^2 + 1 / g_i)^-1, and g_i and a_i the eigenvalues and eigenvectors of G, nu is the
degrees of freedom of the variance of scatter and noise together (Satterthwaite, Biometrics
Bulletin 2 (1946) 110):

    nu = sum e_i^2 (sum a_ij^2 e_i)^2 / (sum a_ij^2 e_i^2)^2 - 1    beside dimension j
    nu = (sum e_i)^2 / sum e_i^2                                    of all dimensions
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
from delta_calibration.effects import SPREAD
from delta_calibration.theta import entries

Array = NDArray[np.float64]

_SCATTERS = np.geomspace(0.01, 10.0, 61)
_MOST = 700.0  # largest exponent whose exponential is finite
_ALIKE = 1e-6  # share of a column up to which it is a combination of others
_SEEN = 1e-3  # least share of the prior's variance that the data must remove


@dataclass(frozen=True)
class Outlier:
    """A dimension tested as an outlier to the scatter of all dimensions."""

    candidate: Candidate
    value: float  # excess deviation in units of its tolerance
    information: float  # on that excess, beside all geometry at the scatter that fits it best
    log_p: float  # ln p, corrected for the number of dimensions
    log_bayes: float
    share: float  # of what geometry explains that this dimension explains alone


@dataclass(frozen=True)
class Scatter:
    """Scatter tau of the dimensions about the drawing, as a share of their tolerances."""

    tau: float
    log_p: float  # ln p of a scatter as large if the dimensions keep their tolerances
    log_bayes: float  # ln of the likelihood over that of dimensions that scatter by tolerances
    outlier: Outlier | None  # the most prominent dimension, significant or not


def scatter_of(evidence: LinearizedModel) -> Scatter:
    """Estimate the scatter of the dimensions and test the most prominent outlier."""
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
    log_bayes = (within - least) / 2
    if best is None:
        return Scatter(tau, log_p, log_bayes, None)
    outlier = _outlier(evidence, best, least, information, b, values, axes)
    return Scatter(tau, log_p, log_bayes, outlier)


def _degrees_beside(values: Array, tau: float, share: Array) -> float:
    """Degrees of freedom of the scatter that a dimension is compared with, at least one.

    Args:
        values: eigenvalues of the information on the dimensions, in units of tolerances, (p,).
        tau: scatter of the dimensions.
        share: squared component of the dimension in each eigenvector, (p,).
    """
    each = values / (1.0 + values * tau**2)
    moved = float(share @ each**2)
    if moved <= 0:
        return 1.0
    return max(1.0, float(each @ each) * float(share @ each) ** 2 / moved**2 - 1.0)


def _log_p_of_size(ratio: float, each: Array) -> float:
    """ln p of a scatter that exceeds the tolerances, from a likelihood ratio (of -2 ln L).

    For n numbers whose mean square is s times the allowed one, ratio = n (s - 1 - ln s).

    Args:
        ratio: decrease of -2 ln L from tau = 1 to the best tau.
        each: e_i at tau = 1, (p,).
    """
    degrees = each.sum() ** 2 / (each @ each)
    size = -lambertw(-np.exp(-1.0 - max(ratio, 0.0) / degrees), -1).real
    return float(log_chi2(degrees * size, degrees))


def _log_p_of_one(ratio: float, degrees: float) -> float:
    """ln p of one number that is an outlier to n others, from a likelihood ratio.

    With Student's t of n degrees of freedom, ratio = (n + 1) ln(1 + t^2 / n).
    """
    square = degrees * np.expm1(np.clip(ratio / (degrees + 1), 0.0, _MOST))
    return float(np.log(2) + log_t(np.sqrt(square), degrees))


def displaced(evidence: LinearizedModel) -> float:
    """ln p of a reflector offset at least as far from its nominal value, under its prior."""
    rows = offset_rows(evidence)
    z, known = evidence.best()[rows], evidence.covariance()[np.ix_(rows, rows)]
    spread = np.eye(len(rows)) - known  # of the most likely values, where z ~ N(0, 1)
    values, axes = np.linalg.eigh(spread)
    seen = values > _SEEN
    square = float(np.sum((axes[:, seen].T @ z) ** 2 / values[seen]))
    return float(log_chi2(square, max(int(seen.sum()), 1)))


def offset_rows(evidence: LinearizedModel) -> NDArray[np.int64]:
    """Indices of the reflector's offset among the nuisance parameters, (3,)."""
    return entries(evidence.chain.layout.offset)


def same_as_the_offset(evidence: LinearizedModel) -> tuple[str, ...]:
    """Causes of dimensions that move the readings exactly as the reflector's offset does.

    Dimensions that the tracker's frame alone imitates are not among them.
    """
    layout, every = evidence.chain.layout, evidence.nuisance.reshape(evidence.size, -1)
    geometry, frame = every[:, layout.geometry], every[:, layout.frame]
    size = np.maximum(np.linalg.norm(geometry, axis=0), np.finfo(float).tiny)

    def beside(columns: Array) -> Array:
        """Share of each dimension's column that is no combination of some others."""
        left = geometry - columns @ np.linalg.lstsq(columns, geometry, rcond=None)[0]
        return np.asarray(np.linalg.norm(left, axis=0) / size)

    both = np.hstack([every[:, layout.offset], frame])
    alike = (beside(both) < _ALIKE) & (beside(frame) > _ALIKE)
    names = (one.cause for one, same in zip(dimensions(evidence), alike, strict=True) if same)
    return tuple(dict.fromkeys(names))


def without(evidence: LinearizedModel, rows: NDArray[np.int64]) -> LinearizedModel:
    """The evidence with some nuisance parameters fixed at their nominal values."""
    kept = np.setdiff1d(np.arange(evidence.nuisance.shape[2]), rows)
    precision = np.delete(evidence.precision, rows)
    return replace(evidence, nuisance=evidence.nuisance[:, :, kept], precision=precision)


def with_whole(
    evidence: LinearizedModel, rows: NDArray[np.int64]
) -> tuple[LinearizedModel, Array]:
    """The evidence for how far named dimensions are off their drawing, and their priors.

    A search knows only their excess over the scatter of all dimensions. The whole deviation takes
    the place of both; the precision of its prior, (k,), follows from those of the two.
    """
    scatter = evidence.precision[rows]
    return without(evidence, rows), scatter / (1 + scatter * SPREAD**2)


def without_geometry(evidence: LinearizedModel) -> LinearizedModel:
    """The evidence with all dimensions fixed at those of the drawing."""
    return without(evidence, entries(evidence.chain.layout.geometry))


def as_known(placed: Fitted) -> LinearizedModel:
    """The evidence of a known machine in which only the placement is fitted.

    Args:
        placed: result of `Fitted.registered`.
    """
    return without(placed.evidence, placed.unplaced)


def at_scatter(evidence: LinearizedModel, tau: float) -> LinearizedModel:
    """The evidence with tau tolerances as the prior of every dimension."""
    precision = evidence.precision.copy()
    precision[evidence.chain.layout.geometry] = tau**-2
    return replace(evidence, precision=precision)


def _unlikeliness(values: Array, along: Array, scatters: Array) -> Array:
    """-2 ln L at each scatter, without the terms that do not depend on it."""
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
