"""From measured poses to what the machine really is."""

from delta_calibration.identification.alternating import JointFit, alternate, together
from delta_calibration.identification.closing import Closing
from delta_calibration.identification.fit import (
    Identification,
    Residuals,
    chain_of,
    identify,
    prepare,
)
from delta_calibration.identification.image import PointInImage
from delta_calibration.identification.joint_residual import JointProblem, joint_covariance
from delta_calibration.identification.mixed import MixedFit, fit_observations
from delta_calibration.identification.noise import Noise, whitening
from delta_calibration.identification.observability import (
    Observability,
    Redundancy,
    observe,
    strong_correlations,
)
from delta_calibration.identification.observations import (
    DistanceBetween,
    HeightAtContact,
    Machine,
    Observation,
    PointMeasured,
    PoseMeasured,
)
from delta_calibration.identification.pose_residual import (
    LinearResidual,
    PoseResidual,
    in_rounds,
    least_squares,
)
from delta_calibration.identification.problem import (
    Problem,
    Solution,
    build_problem,
    robust_weights,
    solve,
)
from delta_calibration.identification.stepwise import (
    Settled,
    all_singular,
    stepwise,
    stepwise_singular,
)
from delta_calibration.identification.swarm import (
    Apso,
    Box,
    Found,
    Pso,
    Qpso,
    SwarmSettings,
    minimise,
)

__all__ = [
    "Apso",
    "Box",
    "Closing",
    "DistanceBetween",
    "Found",
    "HeightAtContact",
    "Identification",
    "JointFit",
    "JointProblem",
    "LinearResidual",
    "Machine",
    "MixedFit",
    "Noise",
    "Observability",
    "Observation",
    "PointInImage",
    "PointMeasured",
    "PoseMeasured",
    "PoseResidual",
    "Problem",
    "Pso",
    "Qpso",
    "Redundancy",
    "Residuals",
    "Settled",
    "Solution",
    "SwarmSettings",
    "all_singular",
    "alternate",
    "build_problem",
    "chain_of",
    "fit_observations",
    "identify",
    "in_rounds",
    "joint_covariance",
    "least_squares",
    "minimise",
    "observe",
    "prepare",
    "robust_weights",
    "solve",
    "stepwise",
    "stepwise_singular",
    "strong_correlations",
    "together",
    "whitening",
]
