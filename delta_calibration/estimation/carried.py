"""What is known of a machine before it is measured: a Gaussian prior in the drawing's place.

With mean m and covariance C = L L^T of the dimensions g and the effects' parameters v, the scaled
unknowns of `problem.py` are

    (g, v) = m + L z,   z ~ N(0, 1)

so that the prior's rows stay z itself. Tracker frame and reflector are as unknown as ever.
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
    """What earlier sessions say of a machine's dimensions (p,) and effects' parameters (k,)."""

    effects: tuple[Effect, ...]  # in the chain
    mean: Array  # (p + k,) [m, rad, each its own unit]
    covariance: Array  # (p + k, p + k)
    joint: Array  # (n, m) [rad or m] at which it was measured: the calibration holds there, too
    sessions: tuple[str, ...] = ()  # that say it

    @property
    def bare(self) -> Carried:
        """The same of the dimensions alone."""
        count = len(self.mean) - sum(len(effect.parameters) for effect in self.effects)
        return replace(
            self,
            effects=(),
            mean=self.mean[:count],
            covariance=self.covariance[:count, :count],
        )

    def applied(self, problem: Problem) -> Problem:
        """The problem with this prior of its dimensions and effects.

        Args:
            problem: of a chain with these effects.
        """
        rows = carried_rows(problem.layout)
        theta, basis = problem.theta0.copy(), problem.basis.copy()
        theta[rows] = self.mean
        basis[np.ix_(rows, rows)] = np.linalg.cholesky(self.covariance)
        known = problem.has_prior.copy()
        known[rows] = True
        return replace(problem, theta0=theta, basis=basis, has_prior=known)


def carried_rows(layout: Layout) -> Index:
    """Entries of theta that are the machine's own: dimensions, then effects, (p + k,)."""
    return np.concatenate([entries(layout.geometry), entries(layout.effects)])
