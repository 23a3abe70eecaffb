"""Prior of a machine from the population of machines of its type.

Each number d_k of a machine is the deviation of a dimension from the drawing in units of its
tolerance, or a parameter of an effect in units of its prior. It belongs to the crowd or is odd:

    p(d_k) = (1 - o_k) N(d_k; m_k, s_k^2) + o_k N(d_k; 0, 1)

with mean m and standard deviation s of the crowd, and o the share of odd numbers, which only
follow the prior of the drawing or of the effect. Such a prior pulls a number towards the crowd
only if the data allow it there; a number that the data place elsewhere is not pulled.

About a fit the likelihood is normal, exp(-d^T L d / 2 + d^T l). The posterior is found by
expectation propagation (Minka 2001): each prior is replaced by a normal prior that, together with
all others, gives the same mean and variance; for mixtures of two normal laws both have a closed
form. The result is a normal prior for this machine, with which it is fitted again.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.effects import Effect
from delta_calibration.estimation.carried import Carried, carried_rows
from delta_calibration.estimation.solver import Solution, spread_of

Array = NDArray[np.float64]

_SWEEPS = 60
_SETTLED = 1e-6  # change of a probability at which the iteration has converged
_KEPT = 0.5  # share of the last prior that each sweep keeps: damping, as updates may oscillate
_NARROWEST = 1e-3  # [tolerances] least standard deviation of a prior found here


@dataclass(frozen=True)
class Population:
    """Distribution of dimensions and effects in machines of a type, in units of their priors."""

    mean: Array  # (p + k,) dimensions off the drawing, then the effects' parameters
    spread: Array  # (p + k,)
    odd: Array  # (p + k,) share of the machines whose number does not belong to the crowd
    effects: tuple[Effect, ...] = ()  # those that most machines have
    found: tuple[tuple[str, float], ...] = ()  # causes, and the share of machines that have them

    @classmethod
    def as_drawn(cls, size: int) -> Population:
        """Return the population of p dimensions that follows from the drawing alone."""
        return cls(np.zeros(size), np.ones(size), np.full(size, 0.05))

    def shown_by(self, at: Conditions) -> Population:
        """Return this population without the effects that these conditions cannot evaluate."""
        able = [not effect.missing(at) for effect in self.effects]
        if all(able):
            return self
        sizes = [len(effect.parameters) for effect in self.effects]
        dimensions = np.ones(len(self.mean) - sum(sizes), dtype=bool)
        here = np.concatenate([dimensions, np.repeat(able, sizes)])
        return replace(
            self,
            mean=self.mean[here],
            spread=self.spread[here],
            odd=self.odd[here],
            effects=tuple(e for e, can in zip(self.effects, able, strict=True) if can),
        )

    def weights(self, causes: Collection[str]) -> tuple[tuple[str, float], ...]:
        """Frequency of each cause over the mean frequency; empty unless all causes have one.

        p values may be divided by weights with a mean of one without more false alarms (Genovese,
        Roeder and Wasserman 2006, Biometrika 93, 509-524).

        Args:
            causes: those that are tested.
        """
        share = {cause: each for cause, each in self.found if cause in causes}
        if not share or len(share) < len(causes):
            return ()
        mean = sum(share.values()) / len(share)
        return tuple((cause, each / mean) for cause, each in share.items())


@dataclass(frozen=True)
class Likelihood:
    """Normal likelihood exp(-d^T L d / 2 + d^T l) of dimensions and effects d; N machines."""

    information: Array  # (..., p, p) L
    along: Array  # (..., p) l


@dataclass(frozen=True)
class Belief:
    """Posterior of machines, from their data and a population; (..., p) each."""

    mean: Array  # of the posterior
    variance: Array
    crowd: Array  # probability that a number belongs to the crowd
    crowd_mean: Array  # posterior mean if it belongs to the crowd
    crowd_variance: Array
    prior_mean: Array  # of the normal prior that replaces the population
    prior_precision: Array


def believe(data: Likelihood, population: Population, before: Belief | None = None) -> Belief:
    """Compute the posterior from data and a population, by expectation propagation.

    Args:
        data: of one machine, or of several at once.
        population: the prior.
        before: posterior under a similar population, as the starting point.
    """
    if before is None:
        precision = np.broadcast_to(np.ones(1), data.along.shape).copy()
        shift = np.zeros(data.along.shape)
        crowd = np.zeros(data.along.shape)
    else:
        precision, crowd = before.prior_precision, before.crowd
        shift = before.prior_precision * before.prior_mean
    diagonal = np.arange(data.along.shape[-1])
    for _ in range(_SWEEPS):
        normal = data.information.copy()
        normal[..., diagonal, diagonal] += precision
        covariance: Array = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        variance = covariance[..., diagonal, diagonal]
        mean = (covariance @ (data.along + shift)[..., None])[..., 0]
        # posterior without the number's own prior: the "cavity"
        free = np.maximum(1 / variance - precision, 1e-12)
        at = (mean / variance - shift) / free
        weight, first, second = _mixed(at, 1 / free, population)
        crowd_mean, crowd_variance = _times(at, 1 / free, population.mean, population.spread**2)
        wanted = np.clip(1 / second - free, 1.0, 1 / _NARROWEST**2)
        pulled = first * (wanted + free) - at * free
        moved = float(np.max(np.abs(weight - crowd), initial=0.0))
        crowd = weight
        precision = _KEPT * precision + (1 - _KEPT) * wanted
        shift = _KEPT * shift + (1 - _KEPT) * pulled
        if moved < _SETTLED:
            break
    return Belief(mean, variance, crowd, crowd_mean, crowd_variance, shift / precision, precision)


def likelihood_of(solution: Solution) -> Likelihood:
    """Likelihood of dimensions and effects from a fit, all other unknowns integrated out.

    If the residuals are larger than the noise, the information is reduced accordingly.
    """
    problem = solution.problem
    root = np.sqrt(solution.weight)[:, None] / spread_of(solution.residual)
    slope = np.repeat(root.ravel(), solution.residual.shape[1])[:, None] * solution.at.rows
    residual = (root * solution.residual).reshape(-1) + slope @ solution.z
    information, along = slope.T @ slope, slope.T @ residual
    here = problem.layout.mask(problem.layout.geometry, problem.layout.effects)[problem.free]
    rest = information[~here][:, ~here] + np.diag(problem.expected[~here])
    carried = np.linalg.solve(rest, information[~here][:, here]).T
    return Likelihood(
        information[here][:, here] - carried @ information[~here][:, here],
        along[here] - carried @ along[~here],
    )


def carried_by(solution: Solution, population: Population) -> Carried:
    """Return the normal prior of this machine from a population.

    Args:
        solution: a fit with the drawing's tolerances as priors, the population's effects in the
            chain and all of the geometry free.
        population: of the machine's dimensions, all of which have a tolerance, and of effects.
    """
    problem, rows = solution.problem, carried_rows(solution.problem.layout)
    unit = np.diag(problem.basis)[rows]
    belief = believe(likelihood_of(solution), population)
    return Carried(
        population.effects,
        problem.theta0[rows] + unit * belief.prior_mean,
        np.diag(unit**2 / belief.prior_precision),
        np.zeros((0, problem.at.joint.shape[1])),
    )


def _mixed(at: Array, variance: Array, population: Population) -> tuple[Array, Array, Array]:
    """Crowd probability, mean and variance of a number measured at `at` with `variance`."""
    crowd = (1 - population.odd) * _density(at - population.mean, variance + population.spread**2)
    odd = population.odd * _density(at, variance + 1)
    weight = crowd / (crowd + odd)
    in_mean, in_variance = _times(at, variance, population.mean, population.spread**2)
    out_mean, out_variance = _times(at, variance, np.zeros(1), np.ones(1))
    mean = weight * in_mean + (1 - weight) * out_mean
    second = weight * (in_variance + in_mean**2) + (1 - weight) * (out_variance + out_mean**2)
    return weight, mean, second - mean**2


def _times(at: Array, variance: Array, mean: Array, spread: Array) -> tuple[Array, Array]:
    """Mean and variance of the product of two normal laws; `spread` is a variance, too."""
    both = 1 / (1 / variance + 1 / spread)
    return both * (at / variance + mean / spread), both


def _density(off: Array, variance: Array) -> Array:
    least = np.finfo(float).tiny
    return np.exp(-0.5 * off**2 / variance) / np.sqrt(variance) + least
