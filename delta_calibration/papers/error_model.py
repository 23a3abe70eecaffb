"""The error model of a session, and where a search may look in it.

Paper 004's (6), of everything that a session leaves unknown: geometry, reflector offset, tracker
frame and, where turns take part, how the probe is mounted, in units z of what one expects of
them, with the priors as rows,

    |e - J d|^2 = sum_i w_i |W_i (y_i - chain(q_i, theta)) - J_i d|^2 / s^2 + sum_prior z_k^2,

about one machine, w and s the weights and the spread of the robust loss. Its sum of squares is
that of one row an unknown, whatever the number of poses: a search may ask it a million times.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation.problem import Problem, robust_weights
from delta_calibration.papers.pose_residual import LinearResidual
from delta_calibration.papers.swarm import Box

Array = NDArray[np.float64]

_FAR = 4.0  # standard deviations of a part; of all parts one in 16 000 is farther off


def error_model(problem: Problem, z: Array, spread: float) -> LinearResidual:
    """The problem about unknowns z (F,), by the unknowns; `spread` of what no part explains."""
    at = problem.linearized(problem.theta(z))
    residual, slope = at.residual, at.slope
    root = np.sqrt(robust_weights(residual))[:, None] / spread
    data = (root[..., None] * slope).reshape(-1, len(z))
    priors = np.eye(len(z))[problem.has_prior[problem.free]]
    error = np.append((root * residual).reshape(-1) + data @ z, np.zeros(len(priors)))
    return LinearResidual.of(np.concatenate([data, priors]), error)


def box_of(problem: Problem) -> Box:
    """Where a machine of these priors may lie, by the unknowns.

    What has no prior, the tracker's frame, stands as far from the one that fits the drawing best
    as parts that far off can turn and shift it.
    """
    slope = problem.linearized(problem.theta0).rows
    known = problem.has_prior[problem.free]
    reach = np.ones(len(known))
    swept = np.linalg.lstsq(slope[:, ~known], slope[:, known], rcond=None)[0]
    reach[~known] = np.linalg.norm(swept, axis=1)
    return Box.about_zero(_FAR * reach)
