"""An encoder or a coupling that creeps or slips: a joint zero that changes with the clock.

dq = c h(time)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Interval, Limits, Stage, diagonal
from delta_calibration.effects.time_course import LIMITS, around, course_of, courses
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class JointZeroDrift(Effect):
    """Ramp or step of each joint's zero."""

    cause: ClassVar[str] = "joint_zero_drift"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    outside: ClassVar[str] = "return to one reference pose every ten minutes, over cooling as well"
    limits: ClassVar[Limits] = LIMITS

    time_constant: float = 0.0  # [s]; 0: ramp
    step_at: float = -1.0  # [s]; negative: no step

    @property
    def parameters(self) -> ParameterSet:
        """c of each joint [rad]: of an hour, of the whole settling or of the step."""
        return self.each_joint("drift", "rad", 0.1e-3, -0.02, 0.02)

    def columns(self, at: Conditions) -> Array:
        """(n, m, m)."""
        course = course_of(at.time, self.time_constant, self.step_at)
        return diagonal(np.repeat(course[:, None], self.mechanism.joints, axis=1))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A ramp, settlings from minutes to an hour, steps."""
        for constant, step in courses(at):
            yield replace(self, time_constant=constant, step_at=step)

    def intervals(self) -> tuple[Interval, ...]:
        """About the time constant or the moment of the step; a ramp has neither."""
        return around(self.time_constant, self.step_at)

    @property
    def bound_to_session(self) -> bool:
        """A drift by the clock says nothing of another day."""
        return True
