"""Gaussian prior of a machine from earlier sessions, in place of the drawing's tolerances.

With mean m and covariance C = L L^T of the dimensions g and the effects' parameters v, the scaled
unknowns of `problem.py` are

    (g, v) = m + L z,   z ~ N(0, 1)

so that the prior's rows stay z itself. The priors of tracker frame and reflector are unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects import Effect
from delta_calibration.estimation.problem import Problem
from delta_calibration.theta import Layout, entries

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Carried:
    """Prior of a machine's dimensions (p,) and effects' parameters (k,) by earlier sessions."""

    effects: tuple[Effect, ...]  # in the chain
    mean: Array  # (p + k,) [m, rad, each its own unit]
    covariance: Array  # (p + k, p + k)
    joint: Array  # (n, m) [rad or m] where it was measured before: the calibration is valid there
    sessions: tuple[str, ...] = ()  # those that it comes from

    @property
    def bare(self) -> Carried:
        """This prior reduced to the dimensions, without effects."""
        count = len(self.mean) - sum(len(effect.parameters) for effect in self.effects)
        return replace(
            self,
            effects=(),
            mean=self.mean[:count],
            covariance=self.covariance[:count, :count],
        )

    def applied(self, problem: Problem) -> Problem:
        """Return the problem with this prior of its dimensions and effects.

        Args:
            problem: its chain has these effects.
        """
        rows = carried_rows(problem.layout)
        theta, basis = problem.theta0.copy(), problem.basis.copy()
        theta[rows] = self.mean
        basis[np.ix_(rows, rows)] = np.linalg.cholesky(self.covariance)
        known = problem.has_prior.copy()
        known[rows] = True
        return replace(problem, theta0=theta, basis=basis, has_prior=known)


def carried_rows(layout: Layout) -> Index:
    """Indices into theta of the machine's own parameters: dimensions, then effects, (p + k,)."""
    return np.concatenate([entries(layout.geometry), entries(layout.effects)])
