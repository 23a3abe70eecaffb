"""Measurement plans: stops with side of approach and payload, and the motion between them.

A plan is a list of stops and, after them, paths that are measured in motion. `legs` converts it to
joint angles over time: a minimum-jerk move to a point short of each stop, a second move into it,
and a dwell.
"""

from delta_calibration.plans.motion import Leg, MotionPath, Plan, legs
from delta_calibration.plans.named import PLANS, make_plan
from delta_calibration.plans.plan_file import read_plan, write_plan
from delta_calibration.plans.points import (
    CUBE,
    HIGH,
    LINE_HALF,
    LOW,
    PLACES,
    PLANE,
    RADIUS,
    joints_toward,
    nominal_joints,
    require_borne,
    require_limits,
    tool_frames,
    tool_points,
)
from delta_calibration.plans.target_file import (
    PLACE,
    TURN,
    Targets,
    commanded_columns,
    read_targets,
)
from delta_calibration.plans.workspace import cube_of

__all__ = [
    "CUBE",
    "HIGH",
    "LINE_HALF",
    "LOW",
    "PLACE",
    "PLACES",
    "PLANE",
    "PLANS",
    "RADIUS",
    "TURN",
    "Leg",
    "MotionPath",
    "Plan",
    "Targets",
    "commanded_columns",
    "cube_of",
    "joints_toward",
    "legs",
    "make_plan",
    "nominal_joints",
    "read_plan",
    "read_targets",
    "require_borne",
    "require_limits",
    "tool_frames",
    "tool_points",
    "write_plan",
]
