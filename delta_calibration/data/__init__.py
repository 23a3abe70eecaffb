"""Commanded and measured data of a session: streams, readings, still moments, poses, motion."""

from delta_calibration.data.conditions import Conditions, at_rest, joined
from delta_calibration.data.motion import Motion, Stroke, motion_of
from delta_calibration.data.poses import Paths, Poses, Survey, collect, require_poses, survey
from delta_calibration.data.readings import Readings, Rejected, match, repeats
from delta_calibration.data.streams import (
    SIMULATED_NS,
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
)

__all__ = [
    "SIMULATED_NS",
    "Conditions",
    "JointStream",
    "Motion",
    "Paths",
    "PayloadStream",
    "Poses",
    "Readings",
    "Rejected",
    "Session",
    "Stroke",
    "Survey",
    "TemperatureStream",
    "TrackerStream",
    "at_rest",
    "collect",
    "joined",
    "match",
    "motion_of",
    "repeats",
    "require_poses",
    "survey",
]
