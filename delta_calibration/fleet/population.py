"""Mean and spread of the numbers of a type of machine, from fits of many: empirical Bayes.

Machine i has dimensions and effects d_i, seen through the likelihood of its data (L_i, l_i);
each is of the crowd N(m, s^2) or odd (`estimation/population.py`). Sought are m, s and the
share o of odd ones that make all data likeliest. A parameter of an effect is of the crowd only in
machines in which a diagnosis found it, and its o is its own; all dimensions share theirs. Parts of
the same kind, as the arms of the three legs, share s, each with a mean of its own. Weak priors
only count where the fleet says nothing: m within a tolerance of the drawing, s about a tolerance,
as a fiftieth of a machine would tell it. By turns:

    E   belief of each machine, by expectation propagation
    m   generalised least squares: machine i tells of m through D - D (L_i + D)^-1 D, with D the
        precision of its dimensions in the crowd (w / s^2; w the probability that one is)
    s   s^2 = sum w (e - m)^2 / sum w (1 - v / s^2), e and v mean and variance of a dimension that
        is in the crowd (MacKay 1992), which goes faster than the expectation's own step
    o   mean of 1 - w

A parameter that most diagnoses did not find is nothing in the crowd. A dimension that no session
shows keeps the tolerance of the drawing.
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

FEWEST = 5  # machines that are a fleet
_ROUNDS = 80
_SETTLED = 1e-4  # [tolerances] change of mean and spread
_AS_ONE = 0.02  # machines that the drawing's own tolerances count for
_ODD = (1.0, 19.0)  # odd dimensions and others that are supposed to be known beforehand
_LACKING = (1.0, 1.0)  # the same of an effect's parameter: Laplace's rule
_NARROWEST, _WIDEST = 0.01, 1.0  # [tolerances] of a spread


@dataclass(frozen=True)
class Estimated:
    """A population and how well it is known."""

    population: Population
    mean_std: Array  # (p + k,)
    told: Array  # (p + k,) so many machines' worth of knowledge of each number is in its spread
    belief: Belief  # of each machine, (N, p + k)


def expected(crowd: Population, told: Array) -> Population:
    """The prior of the next machine: the crowd's, wider by how well its middle is known.

    What no session shows of the middle, combinations of dimensions that do not move the platform,
    does not count: it would not show in the next machine either.

    Args:
        crowd: of the machines that were measured.
        told: (p + k,) so many machines' worth is known of each number.
    """
    wider = np.sqrt(1 + 1 / (told + 1))
    return replace(crowd, spread=np.minimum(wider * crowd.spread, _WIDEST))


@dataclass(frozen=True)
class Looked:
    """In which machines effects were looked for and found."""

    at: Bools  # (N,) machines with a diagnosis
    there: Bools  # (N, k) whether it found each parameter of each effect


def estimate(
    data: Likelihood, kinds: Sequence[str] | None = None, looked: Looked | None = None
) -> Estimated:
    """Estimate the population that N machines are of.

    Args:
        data: of dimensions (p) and effects' parameters (k), in units of the chain's priors off
            the drawing: (N, p + k, p + k) and (N, p + k).
        kinds: of each number, (p + k,); those of one kind share their spread. Each is of its own
            kind where not given.
        looked: where the effects were found; without effects where not given.

    Raises:
        DataError: too few machines.
    """
    machines, size = data.along.shape
    if machines < FEWEST:
        raise DataError(f"{machines} machines of this type; priors need {FEWEST} or more")
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
    """What was not found is not of the crowd that has it."""
    crowd, count = belief.crowd.copy(), looked.there.shape[1]
    crowd[:, crowd.shape[1] - count :] *= looked.there
    return replace(belief, crowd=crowd)


def _odd(belief: Belief, looked: Looked) -> Array:
    """Share of machines in which each number is not of the crowd, (p + k,)."""
    dimensions = belief.crowd.shape[1] - looked.there.shape[1]
    own, effects = belief.crowd[:, :dimensions], belief.crowd[looked.at, dimensions:]
    odd = (np.sum(1 - own) + _ODD[0]) / (own.size + sum(_ODD))
    lacking = (np.sum(1 - effects, axis=0) + _LACKING[0]) / (len(effects) + sum(_LACKING))
    return np.concatenate([np.full(dimensions, odd), lacking])


def _lacking(population: Population, looked: Looked) -> Population:
    """The same with the crowd of what most machines do not have: those that have it are odd."""
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
    """Mean of the crowd and its standard error, (p,) each."""
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
    """Kinds of dimensions by their names: `arm` of `arm_1`, `elbow_half_width` of `..._1a`."""
    return tuple(re.sub(r"_\d+[ab]?\b", "", name) for name in names)


def _spread(
    population: Population, belief: Belief, mean: Array, kind: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Spread of the crowd, and how many machines tell of it, (p,) each."""
    weight = belief.crowd
    known = np.clip(1 - belief.crowd_variance / population.spread**2, 0.0, 1.0)
    own = np.sum(weight * known, axis=0)
    square = np.bincount(kind, np.sum(weight * (belief.crowd_mean - mean) ** 2, axis=0))
    variance = (square + _AS_ONE) / (np.bincount(kind, own) + _AS_ONE)
    return np.clip(np.sqrt(variance[kind]), _NARROWEST, _WIDEST), own
