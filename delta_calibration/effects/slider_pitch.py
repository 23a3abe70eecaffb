"""Pitch error of a slider's screw.

dq = s (q - h)

The reading is true at h, where the carriage was homed: at the mechanism's own zero, or at a
reference switch anywhere on the travel. A wrong h is a constant offset of the slider as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits
from delta_calibration.effects.demo import Demo
from delta_calibration.effects.joint_scale import JointScale
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.mechanisms import Mechanism
from delta_calibration.parameters import ParameterSet
from delta_calibration.robot import Robot

_PLACES = 5  # over the travel, at which a reading is tried to be true


@dataclass(frozen=True)
class SliderPitch(JointScale):
    """Each slider moves farther than its reading, in proportion to its position.

    For mechanisms whose joints are lengths. The column is that of a wrong gear ratio; the expected
    size and the bounds are those of a screw.
    """

    cause: ClassVar[str] = "slider_pitch"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "screw",
        "enter the true pitch of the screw",
        "drive the carriage over its whole travel along a linear scale",
    )
    demo: ClassVar[Demo | None] = Demo("identify", 24)
    limits: ClassVar[Limits] = {"home": (-10.0, 10.0)}
    told: ClassVar[Mapping[str, tuple[str, str]]] = {"home": ("true_at_m", "m")}

    home: float = 0.0  # [m] where the reading is true, from the mechanism's own zero

    @property
    def suits(self) -> bool:
        """Whether the joints slide."""
        return self.mechanism.joint_unit == "m"

    @property
    def parameters(self) -> ParameterSet:
        """s of each slider [1]: a few hundredths of a millimetre over the travel."""
        return self.each_joint("pitch", "1", 50e-6, -2e-3, 2e-3)

    def constants(self, joint: int) -> tuple[float, ...]:
        """Drive reading at that place."""
        return (drive_reading(self.mechanism, joint, self.home),)

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Readings that are true at the mechanism's own zero, and at places over the travel."""
        del at
        yield replace(self, home=0.0)
        for place in np.linspace(*travel(self.robot, self.mechanism), _PLACES).tolist():
            if place:
                yield replace(self, home=place)

    def intervals(self) -> tuple[Interval, ...]:
        """The place between its neighbours in the search; none for the own zero."""
        if not self.home:
            return ()
        low, high = travel(self.robot, self.mechanism)
        step = (high - low) / (_PLACES - 1)
        return (("home", self.home - step, self.home + step),)


def travel(robot: Robot, mechanism: Mechanism) -> tuple[float, float]:
    """Lowest and highest place that a slider reaches, from its own zero [m]."""
    joints, drives = robot.joints, mechanism.drives
    ends = drives.sense * (np.stack([joints.lower, joints.upper]) - drives.zero)
    return float(ends.min()), float(ends.max())


def drive_reading(mechanism: Mechanism, joint: int, place: float) -> float:
    """Reading of a drive at a place of its slider, which is counted from its own zero [m]."""
    return float(mechanism.drives.zero[joint] + mechanism.drives.sense[joint] * place)
