"""The mechanisms, one closure equation a file, found by their registered names."""

from delta_calibration.mechanisms.base import Mechanism
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.mechanisms.linear_delta import LinearDelta
from delta_calibration.mechanisms.rotary_delta import RotaryDelta
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.mechanisms.six_rod_delta import SixRodDelta

MECHANISMS: dict[str, type[DeltaModel]] = {kind.name: kind for kind in (RotaryDelta, SixRodDelta)}

__all__ = ["MECHANISMS", "LinearDelta", "Mechanism", "RotaryDelta", "SerialArm", "SixRodDelta"]
