"""From measured poses to what the machine really is."""

from delta_calibration.identification.alternating import JointFit, alternate, together
from delta_calibration.identification.fit import (
    Identification,
    Residuals,
    chain_of,
    identify,
    prepare,
)
from delta_calibration.identification.joint_residual import JointProblem, joint_covariance
from delta_calibration.identification.noise import Noise, whitening
from delta_calibration.identification.observability import (
    Observability,
    Redundancy,
    observe,
    strong_correlations,
)
from delta_calibration.identification.problem import (
    Problem,
    Solution,
    build_problem,
    robust_weights,
    solve,
)

__all__ = [
    "Identification",
    "JointFit",
    "JointProblem",
    "Noise",
    "Observability",
    "Problem",
    "Redundancy",
    "Residuals",
    "Solution",
    "alternate",
    "build_problem",
    "chain_of",
    "identify",
    "joint_covariance",
    "observe",
    "prepare",
    "robust_weights",
    "solve",
    "strong_correlations",
    "together",
    "whitening",
]
