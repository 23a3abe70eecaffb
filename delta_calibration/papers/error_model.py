"""Linear error model of a session, and the search box of its unknowns.

Paper 004's (6) for all unknowns of a session: geometry, reflector offset, tracker frame and, if
rotations are used, rotation of the probe, in units z of their priors, with the priors as rows,

    |e - J d|^2 = sum_i w_i |W_i (y_i - chain(q_i, theta)) - J_i d|^2 / s^2 + sum_prior z_k^2,

linearised about one machine, with w and s the weights and the spread of the robust loss. The sum
of squares is reduced to one row per unknown, whatever the number of poses, so that a search can
evaluate it a million times.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation.problem import Problem
from delta_calibration.estimation.solver import robust_weights
from delta_calibration.papers.pose_residual import LinearResidual
from delta_calibration.papers.swarm import Box

Array = NDArray[np.float64]

_FAR = 4.0  # standard deviations of a part; one part in 16 000 deviates more


def error_model(problem: Problem, z: Array, spread: float) -> LinearResidual:
    """Linearise the problem about unknowns z, (F,); `spread` is that of the whitened residuals."""
    at = problem.linearized(problem.theta(z))
    residual, slope = at.residual, at.slope
    root = np.sqrt(robust_weights(residual))[:, None] / spread
    data = (root[..., None] * slope).reshape(-1, len(z))
    priors = np.eye(len(z))[problem.has_prior[problem.free]]
    error = np.append((root * residual).reshape(-1) + data @ z, np.zeros(len(priors)))
    return LinearResidual.of(np.concatenate([data, priors]), error)


def box_of(problem: Problem) -> Box:
    """Search box of the unknowns, from their priors.

    Unknowns without prior (the tracker's frame) get as much room about the best frame of the
    nominal machine as parts at the ends of their own intervals can rotate and shift it.
    """
    slope = problem.linearized(problem.theta0).rows
    known = problem.has_prior[problem.free]
    reach = np.ones(len(known))
    swept = np.linalg.lstsq(slope[:, ~known], slope[:, known], rcond=None)[0]
    reach[~known] = np.linalg.norm(swept, axis=1)
    return Box.about_zero(_FAR * reach)
