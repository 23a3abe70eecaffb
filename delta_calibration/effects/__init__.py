"""What machines do that a geometric model leaves out, each a stage of the one chain."""

from delta_calibration.effects.base import SPREAD, Effect, Interval, Stage
from delta_calibration.effects.catalogue import EFFECTS, called, catalogue, effect_named

__all__ = [
    "EFFECTS",
    "SPREAD",
    "Effect",
    "Interval",
    "Stage",
    "called",
    "catalogue",
    "effect_named",
]
