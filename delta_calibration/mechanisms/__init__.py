"""The mechanisms, one closure equation a file, found by their registered names."""

from delta_calibration.mechanisms.base import Mechanism
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.mechanisms.five_axis import FiveAxis
from delta_calibration.mechanisms.rotary_delta import RotaryDelta
from delta_calibration.mechanisms.six_rod_delta import SixRodDelta

MECHANISMS: dict[str, type[DeltaModel]] = {kind.name: kind for kind in (RotaryDelta, SixRodDelta)}

__all__ = ["MECHANISMS", "FiveAxis", "Mechanism", "RotaryDelta", "SixRodDelta"]
