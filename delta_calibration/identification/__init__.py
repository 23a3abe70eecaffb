"""From measured poses to what the machine really is."""

from delta_calibration.identification.fit import (
    Identification,
    Residuals,
    chain_of,
    identify,
    prepare,
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
    Machine,
    Observation,
    PointMeasured,
    PoseMeasured,
)
from delta_calibration.identification.problem import (
    Problem,
    Solution,
    build_problem,
    robust_weights,
    solve,
)

__all__ = [
    "DistanceBetween",
    "HeightAtContact",
    "Identification",
    "Machine",
    "MixedFit",
    "Noise",
    "Observability",
    "Observation",
    "PointMeasured",
    "PoseMeasured",
    "Problem",
    "Redundancy",
    "Residuals",
    "Solution",
    "build_problem",
    "chain_of",
    "fit_observations",
    "identify",
    "observe",
    "prepare",
    "robust_weights",
    "solve",
    "strong_correlations",
    "whitening",
]
