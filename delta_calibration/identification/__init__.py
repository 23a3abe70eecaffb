"""From measured poses to what the machine really is."""

from delta_calibration.identification.alternating import (
    JointFit,
    alternate,
    in_turn,
    together,
)
from delta_calibration.identification.baseline import placing, registered
from delta_calibration.identification.doubt import DIAGNOSIS, doubt, doubts
from delta_calibration.identification.encoder_closures import EncoderClosure
from delta_calibration.identification.error_model import box_of, error_model
from delta_calibration.identification.fit import (
    Effort,
    Identification,
    Residuals,
    chain_of,
    identify,
    most_evaluations,
    parts_of,
    prepare,
    require_this_robot,
    residuals_of,
)
from delta_calibration.identification.image import PointInImage
from delta_calibration.identification.joint_residual import JointProblem, joint_covariance
from delta_calibration.identification.left_out import Known, left_out
from delta_calibration.identification.methods import (
    METHODS,
    ORDERS,
    Fit,
    Method,
    method_named,
)
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
    Linear,
    Machine,
    Measured,
    Observation,
    PointMeasured,
    PoseMeasured,
    RadiusMeasured,
)
from delta_calibration.identification.population import (
    Belief,
    Likelihood,
    Population,
    believe,
    likelihood_of,
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
    solution_at,
    solve,
    spread_of,
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
    "DIAGNOSIS",
    "METHODS",
    "ORDERS",
    "Apso",
    "Belief",
    "Box",
    "DistanceBetween",
    "Effort",
    "EncoderClosure",
    "Fit",
    "Found",
    "HeightAtContact",
    "Identification",
    "JointFit",
    "JointProblem",
    "Known",
    "Likelihood",
    "Linear",
    "LinearResidual",
    "Machine",
    "Measured",
    "Method",
    "MixedFit",
    "Noise",
    "Observability",
    "Observation",
    "PointInImage",
    "PointMeasured",
    "Population",
    "PoseMeasured",
    "PoseResidual",
    "Problem",
    "Pso",
    "Qpso",
    "RadiusMeasured",
    "Redundancy",
    "Residuals",
    "Settled",
    "Solution",
    "SwarmSettings",
    "all_singular",
    "alternate",
    "believe",
    "box_of",
    "build_problem",
    "chain_of",
    "doubt",
    "doubts",
    "error_model",
    "fit_observations",
    "identify",
    "in_rounds",
    "in_turn",
    "joint_covariance",
    "least_squares",
    "left_out",
    "likelihood_of",
    "method_named",
    "minimise",
    "most_evaluations",
    "observe",
    "parts_of",
    "placing",
    "prepare",
    "registered",
    "require_this_robot",
    "residuals_of",
    "robust_weights",
    "solution_at",
    "solve",
    "spread_of",
    "stepwise",
    "stepwise_singular",
    "strong_correlations",
    "together",
    "whitening",
]
