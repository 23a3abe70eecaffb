"""The mechanisms, one closure equation per file, found by their registered names."""

from delta_calibration.mechanisms.base import Mechanism
from delta_calibration.mechanisms.cable_dimensions import CableDimensions, CableTolerances
from delta_calibration.mechanisms.cable_robot import CableRobot
from delta_calibration.mechanisms.drives import Drives
from delta_calibration.mechanisms.five_axis import FiveAxis
from delta_calibration.mechanisms.linear_delta import LinearDelta
from delta_calibration.mechanisms.rotary_delta import RotaryDelta
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.mechanisms.six_rod_delta import SixRodDelta
from delta_calibration.registry import Registry

_EVERY: tuple[type[Mechanism], ...] = (
    RotaryDelta,
    SixRodDelta,
    LinearDelta,
    CableRobot,
    FiveAxis,
    SerialArm,
)
MECHANISMS: Registry[Mechanism] = Registry(
    Mechanism,  # type: ignore[type-abstract]
    "name",
    "delta_calibration.mechanisms",
    _EVERY,
)

__all__ = [
    "MECHANISMS",
    "CableDimensions",
    "CableRobot",
    "CableTolerances",
    "Drives",
    "FiveAxis",
    "LinearDelta",
    "Mechanism",
    "RotaryDelta",
    "SerialArm",
    "SixRodDelta",
]
