"""Performance criteria of ISO 9283 and the poses and paths of its test."""

from delta_calibration.iso9283.criteria import (
    DELTA_PAPER,
    STANDARD,
    Conditions,
    Criterion,
    DistanceAccuracy,
    PathCriterion,
    PositionAccuracy,
    PositionRepeatability,
    direction_variation,
    distance_accuracy,
    distance_repeatability,
    path_accuracy,
    path_deviations,
    path_repeatability,
    position_accuracy,
    position_repeatability,
)
from delta_calibration.iso9283.cube import PLANES, Cube

__all__ = [
    "DELTA_PAPER",
    "PLANES",
    "STANDARD",
    "Conditions",
    "Criterion",
    "Cube",
    "DistanceAccuracy",
    "PathCriterion",
    "PositionAccuracy",
    "PositionRepeatability",
    "direction_variation",
    "distance_accuracy",
    "distance_repeatability",
    "path_accuracy",
    "path_deviations",
    "path_repeatability",
    "position_accuracy",
    "position_repeatability",
]
