"""Effects: errors that a geometric model leaves out, each at one stage of the chain."""

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
