"""Simulated cell: a machine that deviates from its drawing, and the tracker that measures it.

The machine is the chain of measurement run forward with the most detailed model (for a delta, six
rods), parameters drawn at random about the drawing, and any hidden effects: the same chain and the
same effects that are fitted afterwards, with values that the fit is not given.
"""

from delta_calibration.effects.time_course import WARM_UP
from delta_calibration.simulation.camera import CameraOver, other_elbow
from delta_calibration.simulation.climate import AMBIENT, PARTS, Climate
from delta_calibration.simulation.following import Following
from delta_calibration.simulation.hidden import hideable_causes
from delta_calibration.simulation.machine import TrueMachine, draw_machine, standing
from delta_calibration.simulation.options import effect_options
from delta_calibration.simulation.session import RICH_PERIOD, simulate_session
from delta_calibration.simulation.visit import days_later, visited

__all__ = [
    "AMBIENT",
    "PARTS",
    "RICH_PERIOD",
    "WARM_UP",
    "CameraOver",
    "Climate",
    "Following",
    "TrueMachine",
    "days_later",
    "draw_machine",
    "effect_options",
    "hideable_causes",
    "other_elbow",
    "simulate_session",
    "standing",
    "visited",
]
