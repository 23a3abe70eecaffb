"""What makes positions uncertain, by the residuals of a fit: see `delta_calibration.uncertainty`.

What the model leaves out, M, is measured by the residuals of the fit, each enlarged to what it
would be had the fit not taken up a part of it (`cross_validation.py`), less the noise. The less
sure it is, the less of it counts (James and Stein 1961). The same residuals tell, beside repeats,
how far joints come to rest from where they should: what does not count as M of an excess or a lack
goes to s_q, by how unsure that is.

By chance one residual in twenty reaches beyond its 95 %; where more do, `widen` is by how much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc  # scipy.stats takes long to import

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions
from delta_calibration.uncertainty import (
    COVERED,
    MANY,
    ModelError,
    Uncertainty,
    definite,
    half_variance,
    radius95,
    turned_round,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_FEWEST = 20  # poses from which a quantile of 95 % is told
_THIN = 1e-4  # of the largest extent squared: poses thinner than this lie in a plane
_SURE = 3.0  # standard errors from which play is one
_CHANCE = 0.05  # that as many errors reach beyond a radius, below which it is widened
_LEAST_REST = 0.05  # of s_q^2 by repeats, that residuals leave of it


@dataclass(frozen=True)
class Missed:
    """What poses were missed by, as if their fit had taken up nothing of it."""

    at: Conditions  # of the n poses
    residual: Array  # (n, 3) [m] measured less predicted, tracker's frame; NaN: does not count
    whiten: Array  # (n, 3, 3) [1/m] W C W^T = 1, C the covariance of a pose's noise
    place: Index  # (n,) poses of one place have one error of the model


@dataclass(frozen=True)
class Rest:
    """Where joints come to rest, and how well that is known."""

    repeatability: float  # [rad or m] of each joint, one standard deviation
    freedom: float  # degrees of freedom; infinite: as stated


def uncertainty_of(
    chain: Chain, theta: Array, covariance: Array, rest: Rest, missed: Missed
) -> Uncertainty:
    """What makes positions uncertain, by the residuals of the fit.

    Args:
        chain: the model.
        theta: as identified, (P,).
        covariance: of theta, (P, P).
        rest: as repeats tell it, and as it is in the noise of the poses.
        missed: what the poses were missed by.
    """
    rows = np.flatnonzero(np.isfinite(missed.residual).all(axis=1))
    at, place = missed.at.take(rows), missed.place[rows]
    seen = chain.see(at, theta)
    turned = chain.split(theta)[2].rotation
    by_joints = turned.T @ seen.by_joints
    colour = turned.T @ np.linalg.inv(missed.whiten[rows])
    known = colour @ turned_round(colour)
    error = missed.residual[rows] @ turned
    sided = by_joints * np.nan_to_num(at.direction)[:, None, :]
    play = _play(sided, error, known)
    error = error - sided @ play
    moving = by_joints @ turned_round(by_joints)
    split = _split(error, known, moving, rest, place)
    known = known + (split.rest.repeatability**2 - rest.repeatability**2) * moving
    places = chain.mechanism.position(seen.x)
    found = _grown(places, split, np.abs(play), place)
    model = found.at(places)
    kurtosis = _kurtosis(error, known + model, model, place)
    fourth = kurtosis * np.trace(model, axis1=1, axis2=2) ** 2
    ratio = np.linalg.norm(error, axis=1) / radius95(known + model, fourth=fourth)
    found = replace(found, widen=_reached(ratio), kurtosis=kurtosis)
    return Uncertainty(covariance, split.rest.repeatability, found, split.rest.freedom)


def _play(sided: Array, error: Array, known: Array) -> Array:
    """How far each joint is off by the side that it comes from, (m,); 0 where that is chance.

    Args:
        sided: by the joints, times the sides that they came from, (n, 3, m).
        error: (n, 3) [m].
        known: covariance of what else is in it, (n, 3, 3).
    """
    inverse = np.linalg.inv(known)
    normal = np.einsum("nij,nik,nkl->jl", sided, inverse, sided)
    spread = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    value = spread @ np.einsum("nij,nik,nk->j", sided, inverse, error)
    sigma = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return np.where(np.abs(value) > _SURE * sigma, value, 0.0)


@dataclass(frozen=True)
class _Split:
    """Errors told apart: what the model leaves out, and where joints come to rest."""

    covariance: Array  # (3, 3) [m^2] M, mean of the poses
    doubt: float  # [m^2] standard error of its trace
    beyond: Array  # (n,) [m^2] errors squared less the noise
    rest: Rest


def _split(error: Array, known: Array, moving: Array, rest: Rest, place: Index) -> _Split:
    """M of what errors (n, 3) have over the noise, and s_q by repeats and errors together.

    The mean excess x over the noise has the error of its own mean, d, and that of s_q, r, which is
    in the noise: of x +- s, s^2 = d^2 + r^2, M counts as x - s^2 / x where that is above zero. Of
    the rest of x, r^2 / s^2 is what s_q was wrong by, the likeliest where there is no M.

    Args:
        error: (n, 3) [m].
        known: covariance of the noise in it, (n, 3, 3) [m^2].
        moving: J J^T, (n, 3, 3).
        rest: s_q as it is in the noise.
        place: (n,) of each pose.
    """
    beyond = np.sum(error**2, axis=1) - np.trace(known, axis1=1, axis2=2)
    excess = float(np.mean(beyond))
    own = float(np.linalg.norm(np.bincount(place, beyond - excess)) / len(beyond))
    still = rest.repeatability**2 * float(np.trace(moving, axis1=1, axis2=2).mean())
    unsure = still * np.sqrt(2 / rest.freedom)
    doubt = max(float(np.hypot(own, unsure)), np.finfo(float).tiny)
    covariance = definite(error.T @ error / len(error) - known.mean(axis=0))
    whole = float(np.trace(covariance))
    share = 1 - (doubt / excess) ** 2 if excess > doubt and whole > 0.0 else 0.0
    covariance = covariance * (share * excess / whole) if share else np.zeros((3, 3))
    moved = (1 - share) * (unsure / doubt) ** 2  # of the excess, what s_q was wrong by
    factor = max(1 + moved * excess / still, _LEAST_REST) if still > 0.0 else 1.0
    told = share + moved  # by how much the sum of both goes by the errors, not by repeats
    left = ((1 - told) * unsure) ** 2 + (told**2 - share**2) * own**2
    freedom = min(2 * (factor * still) ** 2 / left, MANY) if left > 0.0 else np.inf
    found = Rest(float(rest.repeatability * np.sqrt(factor)), float(freedom))
    return _Split(covariance, float(share * own), beyond, found)


def _grown(places: Array, split: _Split, play: Array, place: Index) -> ModelError:
    """M and how it grows from the middle of places (n, 3)."""
    middle = places.mean(axis=0)
    way = places - middle
    scatter = way.T @ way / len(way)
    shape = np.linalg.pinv(scatter, rcond=_THIN, hermitian=True)
    shape /= max(np.linalg.matrix_rank(shape), 1)
    found = ModelError(split.covariance, middle, shape, 0.0, 1.0, play, split.doubt)
    if not np.trace(split.covariance) > 0.0:
        return found
    farther = np.einsum("ni,ij,nj->n", way, shape, way) - 1
    relative = split.beyond / float(np.mean(split.beyond)) - 1
    return replace(found, share=_growing(farther, relative, place))


def _growing(farther: Array, left: Array, place: Index) -> float:
    """How errors squared over their mean, less 1, (n,) go with r^2 - 1 (n,), as far as is sure."""
    whole = max(float(farther @ farther), np.finfo(float).tiny)
    share = float(farther @ left) / whole
    doubt = float(np.linalg.norm(np.bincount(place, farther * (left - share * farther)))) / whole
    if share <= doubt:
        return 0.0
    return min(share - doubt**2 / share, 1.0)


def _kurtosis(error: Array, whole: Array, model: Array, place: Index) -> float:
    """k, as far as it is sure, of errors (n, 3) of covariance `whole`, `model` of it the model's.

    At least so that what the model leaves out has a variance of its square.
    """
    square, size = (np.trace(each, axis1=1, axis2=2) for each in (whole, model))
    weight = float(np.sum(size**2))
    if weight <= 0.0:
        return 0.0
    each = (np.sum(error**2, axis=1) - square) ** 2 - 2 * half_variance(whole, 0.0)
    found = float(np.sum(each)) / weight
    doubt = float(np.linalg.norm(np.bincount(place, each - found * size**2))) / weight
    if abs(found) <= doubt:
        return 0.0
    least = -2 * float(np.sum(model[0] ** 2)) / float(size[0]) ** 2
    return max(found - doubt**2 / found, least)


def _reached(ratio: Array) -> float:
    """Factor on the radius: the 95 % of ratios (n,), where more exceed 1 than do by chance."""
    above = int(np.sum(ratio > 1.0))
    if len(ratio) < _FEWEST or bdtrc(above - 1, len(ratio), 1 - COVERED) > _CHANCE:
        return 1.0
    return max(1.0, float(np.quantile(ratio, COVERED)))
