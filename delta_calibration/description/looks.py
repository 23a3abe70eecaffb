"""Registry of the looks of all mechanisms by name; a look of this package needs a line here."""

from __future__ import annotations

from delta_calibration.description.cable_robot import CableRobotLook
from delta_calibration.description.five_axis import FiveAxisLook
from delta_calibration.description.linear_delta import LinearDeltaLook
from delta_calibration.description.look import Look
from delta_calibration.description.rotary_delta import RotaryDeltaLook
from delta_calibration.description.serial_arm import SerialArmLook
from delta_calibration.description.six_rod_delta import SixRodDeltaLook
from delta_calibration.registry import Registry

LOOKS: Registry[Look] = Registry(
    Look,  # type: ignore[type-abstract]
    "mechanism",
    "delta_calibration.looks",
    (
        RotaryDeltaLook,
        SixRodDeltaLook,
        LinearDeltaLook,
        CableRobotLook,
        FiveAxisLook,
        SerialArmLook,
    ),
)
