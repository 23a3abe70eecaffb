"""Estimate mean and spread of a machine type's parameters from many machines: empirical Bayes.

Machine i has dimensions and effects d_i, with the likelihood (L_i, l_i) of its data. Each number
belongs to the crowd N(m, s^2) or is odd, an outlier (`estimation/population.py`). The estimate is
the m, s and share o of odd ones with the highest likelihood of all data. A parameter of an effect
belongs to the crowd only in machines in which a diagnosis found it, and has its own o; all
dimensions share one o. Parts of the same kind, such as the arms of the three legs, share s but
have their own means. Weak priors only matter where the fleet has no data: m within a tolerance of
the drawing, s about a tolerance, with the weight of a fiftieth of a machine. In turns:

    E   belief of each machine, by expectation propagation
    m   generalised least squares: machine i has the information D - D (L_i + D + 1 - w)^-1 D
        about m, with D = w / s^2 the precision of its dimensions in the crowd and w the
        probability that one is in it (if odd, its precision is 1)
    s   s^2 = sum w (e - m)^2 / sum w (1 - v / s^2), e and v mean and variance of a dimension that
        is in the crowd (MacKay 1992), which converges faster than the update of plain EM
    o   mean of 1 - w

A parameter that most diagnoses did not find has mean 0 in the crowd. A dimension that no session
identifies keeps the tolerance of the drawing.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.estimation import Belief, Likelihood, Population, believe

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FEWEST = 5  # least number of machines in a fleet
_ROUNDS = 80
_SETTLED = 1e-4  # [tolerances] change of mean and spread at convergence
_AS_ONE = 0.02  # [machines] weight of the drawing's own tolerances
_ODD = (1.0, 19.0)  # prior counts of odd dimensions and of others
_LACKING = (1.0, 1.0)  # prior counts for an effect's parameter: Laplace's rule
_NARROWEST, _WIDEST = 0.01, 1.0  # [tolerances] bounds of a spread


@dataclass(frozen=True)
class Estimated:
    """An estimated population with its uncertainty."""

    population: Population
    mean_std: Array  # (p + k,)
    told: Array  # (p + k,) [machines] effective number that each spread was estimated from
    belief: Belief  # of each machine, (N, p + k)


def expected(crowd: Population, told: Array) -> Population:
    """Prior of the next machine: that of the crowd, widened by the uncertainty of its mean.

    Redundant combinations of dimensions, which do not move the platform, do not widen it: they
    cannot be identified in the next machine either.

    Args:
        crowd: population of the measured machines.
        told: (p + k,) effective number of machines that each spread was estimated from.
    """
    wider = np.sqrt(1 + 1 / (told + 1))
    return replace(crowd, spread=np.minimum(wider * crowd.spread, _WIDEST))


@dataclass(frozen=True)
class Looked:
    """In which machines effects were searched for, and in which they were found."""

    at: Bools  # (N,) machines with a diagnosis
    there: Bools  # (N, k) whether each parameter of the effects was found


def estimate(
    data: Likelihood, kinds: Sequence[str] | None = None, looked: Looked | None = None
) -> Estimated:
    """Estimate the population that N machines belong to.

    Args:
        data: likelihood of dimensions (p) and effects' parameters (k), in units of the chain's
            priors about the drawing: (N, p + k, p + k) and (N, p + k).
        kinds: kind of each number, (p + k,); numbers of one kind share their spread. By default
            each number is a kind of its own.
        looked: machines in which the effects were found; None without effects.

    Raises:
        DataError: too few machines.
    """
    machines, size = data.along.shape
    if machines < FEWEST:
        raise DataError(f"{machines} machines of this type; priors need at least {FEWEST}")
    if looked is None:
        looked = Looked(np.ones(machines, dtype=bool), np.ones((machines, 0), dtype=bool))
    population, belief = Population.as_drawn(size), None
    number = np.arange(size) if kinds is None else np.unique(kinds, return_inverse=True)[1]
    for _ in range(_ROUNDS):
        belief = _found(believe(data, population, belief), looked)
        mean, std = _mean(data, population, belief)
        spread, told = _spread(population, belief, mean, number)
        odd = _odd(belief, looked)
        last, population = population, Population(mean, spread, odd)
        moved = (np.abs(last.mean - mean).max(), np.abs(last.spread - spread).max())
        if max(moved) < _SETTLED:
            break
    belief = _found(believe(data, population, belief), looked)
    return Estimated(_lacking(population, looked), std, told, belief)


def _found(belief: Belief, looked: Looked) -> Belief:
    """Set the probability of the crowd to 0 where a diagnosis did not find a parameter."""
    crowd, count = belief.crowd.copy(), looked.there.shape[1]
    crowd[:, crowd.shape[1] - count :] *= looked.there
    return replace(belief, crowd=crowd)


def _odd(belief: Belief, looked: Looked) -> Array:
    """Share of machines in which each number does not belong to the crowd, (p + k,)."""
    dimensions = belief.crowd.shape[1] - looked.there.shape[1]
    own, effects = belief.crowd[:, :dimensions], belief.crowd[looked.at, dimensions:]
    odd = (np.sum(1 - own) + _ODD[0]) / (own.size + sum(_ODD))
    lacking = (np.sum(1 - effects, axis=0) + _LACKING[0]) / (len(effects) + sum(_LACKING))
    return np.concatenate([np.full(dimensions, odd), lacking])


def _lacking(population: Population, looked: Looked) -> Population:
    """Set the crowd to 0 for effects that most machines do not have; those that do are odd."""
    having = looked.there[looked.at]
    dimensions = np.zeros(len(population.mean) - having.shape[1])
    found = (having.sum(axis=0) + _LACKING[1]) / (len(having) + sum(_LACKING))
    share = np.concatenate([dimensions, found])
    rare = (np.arange(len(share)) >= len(dimensions)) & (share < 1 / 2)
    return replace(
        population,
        mean=np.where(rare, 0.0, population.mean),
        spread=np.where(rare, _NARROWEST, population.spread),
        odd=np.where(rare, share, population.odd),
    )


def _mean(data: Likelihood, population: Population, belief: Belief) -> tuple[Array, Array]:
    """Mean of the crowd and its standard error, (p + k,) each."""
    size = data.along.shape[-1]
    crowd = belief.crowd / population.spread**2
    odd = 1 - belief.crowd
    eye = np.eye(size)
    whole = data.information + (crowd + odd)[..., None] * eye
    carried = crowd[..., None] * np.linalg.inv(whole)  # D (L + D)^-1
    information = crowd[..., None] * eye - carried * crowd[:, None, :]
    told = (carried @ data.along[..., None])[..., 0]
    covariance = np.linalg.inv(information.sum(axis=0) + eye)
    return covariance @ told.sum(axis=0), np.sqrt(np.diag(covariance))


def kinds_of(names: Sequence[str]) -> tuple[str, ...]:
    """Kinds of parameters from their names: `arm` for `arm_1`, `elbow_half_width` for `..._1a`."""
    return tuple(re.sub(r"_\d+[ab]?\b", "", name) for name in names)


def _spread(
    population: Population, belief: Belief, mean: Array, kind: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Spread of the crowd, and the effective number of machines it is from, (p + k,) each."""
    weight = belief.crowd
    known = np.clip(1 - belief.crowd_variance / population.spread**2, 0.0, 1.0)
    own = np.sum(weight * known, axis=0)
    square = np.bincount(kind, np.sum(weight * (belief.crowd_mean - mean) ** 2, axis=0))
    variance = (square + _AS_ONE) / (np.bincount(kind, own) + _AS_ONE)
    return np.clip(np.sqrt(variance[kind]), _NARROWEST, _WIDEST), own
