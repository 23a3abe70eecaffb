"""From measured poses to what the machine really is."""

from delta_calibration.estimation.cross_validation import Known, left_out
from delta_calibration.estimation.encoder_closures import EncoderClosure
from delta_calibration.estimation.fit import (
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
from delta_calibration.estimation.image import PointInImage
from delta_calibration.estimation.measurements import (
    DistanceBetween,
    HeightAtContact,
    Linear,
    Measured,
    Observation,
    PlacedMachine,
    PointMeasured,
    PoseMeasured,
    RadiusMeasured,
)
from delta_calibration.estimation.mixed_measurements import MixedFit, fit_observations
from delta_calibration.estimation.noise import Noise, whitening
from delta_calibration.estimation.observability import (
    Observability,
    Redundancy,
    observe,
    strong_correlations,
)
from delta_calibration.estimation.population import (
    Belief,
    Likelihood,
    Population,
    believe,
    likelihood_of,
)
from delta_calibration.estimation.problem import (
    Problem,
    Solution,
    build_problem,
    robust_weights,
    solution_at,
    solve,
    spread_of,
)
from delta_calibration.estimation.registration import placing, registered
from delta_calibration.estimation.warnings import DIAGNOSIS, doubt, doubts
from delta_calibration.papers.alternating import (
    TogetherFit,
    alternate,
    fit_together,
    in_turn,
)
from delta_calibration.papers.error_model import box_of, error_model
from delta_calibration.papers.joint_residual import JointProblem, joint_covariance
from delta_calibration.papers.methods import (
    METHODS,
    ORDERS,
    Fit,
    Method,
    method_named,
)
from delta_calibration.papers.pose_residual import (
    LinearResidual,
    PoseResidual,
    in_rounds,
    least_squares,
)
from delta_calibration.papers.stepwise import (
    Settled,
    all_singular,
    stepwise,
    stepwise_singular,
)
from delta_calibration.papers.swarm import (
    Apso,
    Box,
    Pso,
    Qpso,
    SwarmResult,
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
    "HeightAtContact",
    "Identification",
    "JointProblem",
    "Known",
    "Likelihood",
    "Linear",
    "LinearResidual",
    "Measured",
    "Method",
    "MixedFit",
    "Noise",
    "Observability",
    "Observation",
    "PlacedMachine",
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
    "SwarmResult",
    "SwarmSettings",
    "TogetherFit",
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
    "fit_together",
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
    "whitening",
]
