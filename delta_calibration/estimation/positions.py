"""Uncertainty of positions from the residuals of a fit: see `delta_calibration.uncertainty`.

The model error M is estimated from the studentized residuals of the fit (`cross_validation.py`),
less the noise. It is shrunk the more, the more uncertain it is (James and Stein 1961). Beside the
repeats, the same residuals determine the repeatability s_q of the joints: the part of an excess or
a lack that is not attributed to M changes s_q, in proportion to the uncertainty of s_q.

By chance one residual in twenty exceeds its 95 % radius; if more do, `widen` enlarges the radius.
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

_FEWEST = 20  # poses from which a quantile of 95 % is estimated
_THIN = 1e-4  # of the largest extent squared: poses thinner than this lie in a plane
_SURE = 3.0  # standard errors from which backlash is significant
_CHANCE = 0.05  # probability of so many errors beyond a radius, below which it is enlarged
_LEAST_REST = 0.05  # least ratio of the corrected s_q^2 to that by repeats


@dataclass(frozen=True)
class Missed:
    """Studentized residuals of poses: as large as if the fit had absorbed none of them."""

    at: Conditions  # of the n poses
    residual: Array  # (n, 3) [m] measured less predicted, tracker's frame; NaN: rejected
    whiten: Array  # (n, 3, 3) [1/m] W C W^T = 1, C the covariance of a pose's noise
    place: Index  # (n,) poses of one place have the same model error


@dataclass(frozen=True)
class Rest:
    """Repeatability of the joints, and its degrees of freedom."""

    repeatability: float  # [rad or m] of each joint, one standard deviation
    freedom: float  # degrees of freedom; infinite: as stated


def uncertainty_of(
    chain: Chain, theta: Array, covariance: Array, rest: Rest, missed: Missed
) -> Uncertainty:
    """Estimate the uncertainty of positions from the residuals of the fit.

    Args:
        chain: the model.
        theta: as identified, (P,).
        covariance: of theta, (P, P).
        rest: repeatability as estimated from repeats and as contained in the noise of the poses.
        missed: studentized residuals of the poses.
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
    found = replace(found, widen=reached(ratio), kurtosis=kurtosis)
    return Uncertainty(covariance, split.rest.repeatability, found, split.rest.freedom)


def _play(sided: Array, error: Array, known: Array) -> Array:
    """Backlash of each joint, signed by the side of approach, (m,); 0 if not significant.

    Args:
        sided: derivatives by the joints, times their directions of approach, (n, 3, m).
        error: residuals, (n, 3) [m].
        known: covariance of the residuals without backlash, (n, 3, 3).
    """
    inverse = np.linalg.inv(known)
    normal = np.einsum("nij,nik,nkl->jl", sided, inverse, sided)
    spread = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    value = spread @ np.einsum("nij,nik,nk->j", sided, inverse, error)
    sigma = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return np.where(np.abs(value) > _SURE * sigma, value, 0.0)


@dataclass(frozen=True)
class _Split:
    """Errors separated into the model error and the repeatability of the joints."""

    covariance: Array  # (3, 3) [m^2] M, mean over the poses
    doubt: float  # [m^2] standard error of its trace
    beyond: Array  # (n,) [m^2] errors squared less the noise
    rest: Rest


def _split(error: Array, known: Array, moving: Array, rest: Rest, place: Index) -> _Split:
    """M from the excess of errors (n, 3) over the noise, and s_q from repeats and errors together.

    The mean excess x of squared errors over the noise has a standard error s, s^2 = d^2 + r^2: d
    by the scatter of x itself, r by the uncertainty of s_q in the noise. M gets x - s^2 / x if
    x > s, else 0. Of the rest of x, the share r^2 / s^2 is attributed to s_q, which is the most
    likely split without M.

    Args:
        error: residuals, (n, 3) [m].
        known: covariance of their noise, (n, 3, 3) [m^2].
        moving: J J^T, (n, 3, 3).
        rest: s_q as contained in the noise.
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
    moved = (1 - share) * (unsure / doubt) ** 2  # share of the excess attributed to s_q
    factor = max(1 + moved * excess / still, _LEAST_REST) if still > 0.0 else 1.0
    told = share + moved  # weight of the errors, not the repeats, in the sum
    left = ((1 - told) * unsure) ** 2 + (told**2 - share**2) * own**2
    freedom = min(2 * (factor * still) ** 2 / left, MANY) if left > 0.0 else np.inf
    found = Rest(float(rest.repeatability * np.sqrt(factor)), float(freedom))
    return _Split(covariance, float(share * own), beyond, found)


def _grown(places: Array, split: _Split, play: Array, place: Index) -> ModelError:
    """M and its growth with the distance from the centre of places (n, 3)."""
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
    """Slope b of relative squared errors less 1 (n,) by r^2 - 1 (n,), shrunk, from 0 to 1."""
    whole = max(float(farther @ farther), np.finfo(float).tiny)
    share = float(farther @ left) / whole
    doubt = float(np.linalg.norm(np.bincount(place, farther * (left - share * farther)))) / whole
    if share <= doubt:
        return 0.0
    return min(share - doubt**2 / share, 1.0)


def _kurtosis(error: Array, whole: Array, model: Array, place: Index) -> float:
    """Kurtosis k of the model error, shrunk, by errors (n, 3); covariance `whole`, M `model`.

    Bounded below so that the variance of the squared model error is not negative.
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


def reached(ratio: Array) -> float:
    """Factor on the radius: the 95 % quantile of ratios (n,) if too many exceed 1; else 1."""
    above = int(np.sum(ratio > 1.0))
    if len(ratio) < _FEWEST or bdtrc(above - 1, len(ratio), 1 - COVERED) > _CHANCE:
        return 1.0
    return max(1.0, float(np.quantile(ratio, COVERED)))
