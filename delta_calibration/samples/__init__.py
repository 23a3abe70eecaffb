"""What was commanded and measured: streams, readings, still moments, poses, noise."""

from delta_calibration.samples.poses import Poses, collect, require_poses
from delta_calibration.samples.readings import Readings, Rejected, match
from delta_calibration.samples.streams import (
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
)

__all__ = [
    "JointStream",
    "PayloadStream",
    "Poses",
    "Readings",
    "Rejected",
    "Session",
    "TemperatureStream",
    "TrackerStream",
    "collect",
    "match",
    "require_poses",
]
