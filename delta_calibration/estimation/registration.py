"""The "before" model of all outputs: the known machine in its best-fit frame.

The tracker's frame, the reflector's offset on the platform and the parameters that the robot file
declares unknown (a tolerance without bounds) are not errors of the machine. They are fitted, with
their priors; all other parameters keep their known values: nominal, or those of the active
calibration. A fit, a verdict, their pages and the node all use this module.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation.problem import Problem
from delta_calibration.estimation.solver import Solution, solve

Mask = NDArray[np.bool_]


def placing(problem: Problem) -> Mask:
    """Mask (P,) of the free frame, offset and mount entries, and of those without a prior."""
    layout = problem.layout
    placed = layout.mask(layout.offset, layout.frame, layout.mount)
    return np.asarray(problem.free & (placed | ~problem.has_prior))


def registered(problem: Problem) -> Solution:
    """Fit frame, reflector offset and parameters without prior; hold the rest at theta0.

    Args:
        problem: theta0 is the known machine; parameters that are not free in it stay fixed.

    Raises:
        DataError: poses that the machine cannot reach.
    """
    return solve(problem.only(placing(problem)))
