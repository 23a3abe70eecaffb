"""Solvers of a session's estimation problem: their interface, and least squares.

The methods of the papers are in `papers/`; none of them is needed here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from delta_calibration.estimation.problem import Near, Problem
from delta_calibration.estimation.solver import SETTLED, Solution, solve

Watch = Callable[[int], object]
"""Is told how many evaluations were made since it was told last."""

_GOOD_ENOUGH = 0.05  # decrease of chi square to stop at, in fits that only predict held-out data


@dataclass(frozen=True)
class Fit:
    """Result of a method, and the number of its evaluations."""

    solution: Solution
    # of the chain in least squares, of the error model in other methods
    evaluations: int


class Method(ABC):
    """Base of all methods that solve an estimation problem."""

    name: str

    @abstractmethod
    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Near | None = None,
    ) -> Fit:
        """Solve the problem.

        Args:
            problem: with all parameters that may be wrong free.
            rng: generator of all random numbers.
            watch: called with the number of new evaluations while the method runs.
            near: a fit to these poses and to held-out ones, which the result is to predict.
                Only a method whose result does not depend on its start may start there.

        Raises:
            DataError: no convergence, or a machine that cannot reach a pose.
        """

    def most(self, unknowns: int) -> int:
        """Largest number of evaluations that a fit reports to `watch`; 0 if it is fast."""
        del unknowns
        return 0

    @property
    def settings(self) -> Mapping[str, int | str]:
        """Settings of the method, for the record."""
        return {}


@dataclass(frozen=True)
class LeastSquares(Method):
    """Least squares by Levenberg-Marquardt on the chain."""

    name: str = "least_squares"

    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Near | None = None,
    ) -> Fit:
        """See `Method.fit`; uses no random numbers."""
        del rng, watch
        found = solve(problem, near, settled=SETTLED if near is None else _GOOD_ENOUGH)
        return Fit(found, found.evaluations)
