"""Measurement plans: where to stop, from which side, with what load, and the motion between.

A plan is a list of stops and, after them, paths that are measured in motion. `legs` turns it
into joint angles over time: a minimum-jerk move to a point short of each stop, another into it, a
dwell.
"""

from delta_calibration.plans.motion import Leg, MotionPath, Plan, legs
from delta_calibration.plans.named import make_plan
from delta_calibration.plans.plan_file import read_plan, write_plan
from delta_calibration.plans.points import (
    CUBE,
    LINE_HALF,
    PLANE,
    nominal_joints,
    read_points,
    tool_points,
)

__all__ = [
    "CUBE",
    "LINE_HALF",
    "PLANE",
    "Leg",
    "MotionPath",
    "Plan",
    "legs",
    "make_plan",
    "nominal_joints",
    "read_plan",
    "read_points",
    "tool_points",
    "write_plan",
]
