"""What "before" is, wherever it is said: the machine as it is known, in its best place.

How the machine stands before the tracker, where the reflector sits on its platform and what the
robot's file says to be unknown (a tolerance without bounds) are no errors of the machine. They are
fitted, by their priors, and all else stays as it is known: as drawn, or as the calibration in
force has it. A fit, a verdict, their pages and the node ask here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation.problem import Problem, Solution, solve

Mask = NDArray[np.bool_]


def placing(problem: Problem) -> Mask:
    """Which entries of theta place the machine and its reflector, and are no errors, (P,)."""
    layout = problem.layout
    placed = layout.mask(layout.offset, layout.frame, layout.mount)
    return np.asarray(problem.free & (placed | ~problem.has_prior))


def registered(problem: Problem) -> Solution:
    """The machine as theta0 has it, in the best frame, with the reflector where it fits best.

    Args:
        problem: theta0 is what is known; what is not free in it is held.

    Raises:
        DataError: poses that the machine cannot reach.
    """
    return solve(problem.only(placing(problem)))
