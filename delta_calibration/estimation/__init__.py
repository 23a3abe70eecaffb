"""Identification of a machine's parameters from measured poses."""

from delta_calibration.estimation.carried import Carried, carried_rows
from delta_calibration.estimation.cross_validation import Known, studentized
from delta_calibration.estimation.encoder_closures import EncoderClosure
from delta_calibration.estimation.fit import (
    FEWEST_CARRIED,
    PRIOR_HISTORY,
    PRIOR_POPULATION,
    Effort,
    Identification,
    chain_of,
    identify,
    most_evaluations,
    prepare,
    told_by,
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
from delta_calibration.estimation.method import Fit, LeastSquares, Method
from delta_calibration.estimation.mixed_measurements import MixedFit, fit_observations
from delta_calibration.estimation.noise import Noise, interval_of, whitening
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
    carried_by,
    likelihood_of,
)
from delta_calibration.estimation.positions import Missed, Rest, uncertainty_of
from delta_calibration.estimation.problem import (
    Near,
    Problem,
    build_problem,
    scales,
    widened,
)
from delta_calibration.estimation.registration import placing, registered
from delta_calibration.estimation.residuals import Residuals, parts_of, residuals_of
from delta_calibration.estimation.same_robot import require_this_robot
from delta_calibration.estimation.solver import (
    Solution,
    offset_is_doubtful,
    robust_weights,
    solution_at,
    solve,
    spread_of,
)
from delta_calibration.estimation.turns import never_turned, with_turns
from delta_calibration.estimation.warnings import DIAGNOSIS, doubt, doubts

__all__ = [
    "DIAGNOSIS",
    "FEWEST_CARRIED",
    "PRIOR_HISTORY",
    "PRIOR_POPULATION",
    "Belief",
    "Carried",
    "DistanceBetween",
    "Effort",
    "EncoderClosure",
    "Fit",
    "HeightAtContact",
    "Identification",
    "Known",
    "LeastSquares",
    "Likelihood",
    "Linear",
    "Measured",
    "Method",
    "Missed",
    "MixedFit",
    "Near",
    "Noise",
    "Observability",
    "Observation",
    "PlacedMachine",
    "PointInImage",
    "PointMeasured",
    "Population",
    "PoseMeasured",
    "Problem",
    "RadiusMeasured",
    "Redundancy",
    "Residuals",
    "Rest",
    "Solution",
    "believe",
    "build_problem",
    "carried_by",
    "carried_rows",
    "chain_of",
    "doubt",
    "doubts",
    "fit_observations",
    "identify",
    "interval_of",
    "likelihood_of",
    "most_evaluations",
    "never_turned",
    "observe",
    "offset_is_doubtful",
    "parts_of",
    "placing",
    "prepare",
    "registered",
    "require_this_robot",
    "residuals_of",
    "robust_weights",
    "scales",
    "solution_at",
    "solve",
    "spread_of",
    "strong_correlations",
    "studentized",
    "told_by",
    "uncertainty_of",
    "whitening",
    "widened",
    "with_turns",
]
