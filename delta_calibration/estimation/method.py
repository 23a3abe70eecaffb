"""How a session's least-squares problem is solved: the interface, and least squares itself.

Other methods, those of the papers, are in `papers/`; none of them is needed here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation.problem import SETTLED, Problem, Solution, solve

Array = NDArray[np.float64]

Watch = Callable[[int], object]
"""Is told how many evaluations were made since it was told last."""

_GOOD_ENOUGH = 0.05  # of chi square, in fits that only predict what was held out


@dataclass(frozen=True)
class Fit:
    """Where a method came to rest, and what it cost."""

    solution: Solution
    # machines that were tried: by the chain in least squares, else by the error model
    evaluations: int


class Method(ABC):
    """A way from a problem to its solution."""

    name: str

    @abstractmethod
    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Array | None = None,
    ) -> Fit:
        """Solve the problem.

        Args:
            problem: with all that may be wrong free.
            rng: source of all chance.
            watch: is told of evaluations while they are made.
            near: a fit to these poses and others. What is asked for is then a prediction of the
                others, and only a method that ends at the same place wherever it begins may begin
                there.

        Raises:
            DataError: no rest, or a machine that cannot reach a pose.
        """

    def most(self, unknowns: int) -> int:
        """Evaluations of a fit at most that `watch` hears of, 0 where it takes no time."""
        del unknowns
        return 0

    @property
    def settings(self) -> Mapping[str, int | str]:
        """What was chosen of it, for the record."""
        return {}


@dataclass(frozen=True)
class LeastSquares(Method):
    """Levenberg-Marquardt on the chain."""

    name: str = "least_squares"

    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Array | None = None,
    ) -> Fit:
        """See `Method.fit`; nothing is left to chance."""
        del rng, watch
        found = solve(problem, near, settled=SETTLED if near is None else _GOOD_ENOUGH)
        return Fit(found, found.evaluations)
