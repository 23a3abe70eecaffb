"""The circle test: circular deviation, the share of each cause in it, and what to repair first."""

from delta_calibration.circle_test.ballbar import Ballbar, diagnose_ballbar, read_ballbar
from delta_calibration.circle_test.circles import Circle, find_circles, pairs
from delta_calibration.circle_test.shares import (
    DIMENSIONS,
    FOLLOWING,
    NOISE,
    NOT_EXPLAINED,
    CircleTest,
    Measured,
    PartError,
    Share,
    ballbar_test,
    circle_test,
    measured_circles,
)

__all__ = [
    "DIMENSIONS",
    "FOLLOWING",
    "NOISE",
    "NOT_EXPLAINED",
    "Ballbar",
    "Circle",
    "CircleTest",
    "Measured",
    "PartError",
    "Share",
    "ballbar_test",
    "circle_test",
    "diagnose_ballbar",
    "find_circles",
    "measured_circles",
    "pairs",
    "read_ballbar",
]
