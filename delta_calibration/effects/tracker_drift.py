"""A tracker whose stand or zero creeps: a small rigid motion of all readings over time.

dy = (t + w x y) h(time)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Interval, Limits, Stage
from delta_calibration.effects.time_course import LIMITS, around, course_of, courses
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class TrackerDrift(Effect):
    """Rigid drift; h a ramp, a settling with `time_constant` [s] (0 is the ramp) or a step."""

    cause: ClassVar[str] = "tracker_drift"
    kind: ClassVar[str] = "measurement"
    stage: ClassVar[Stage] = Stage.MEASUREMENT
    outside: ClassVar[str] = "measure three reflectors fixed to the floor, every ten minutes"
    limits: ClassVar[Limits] = LIMITS

    time_constant: float = 0.0  # [s]
    step_at: float = -1.0  # [s]; negative: no step

    @property
    def parameters(self) -> ParameterSet:
        """Shift [m] and turn [rad] of an hour, of the whole settling or of the step."""
        names = [("shift", "m", 30e-6, 2e-3), ("turn", "rad", 10e-6, 1e-3)]
        return ParameterSet(
            tuple(
                Parameter(f"{name}_{axis}", unit, 0.0, prior, self.cause, None, -most, most)
                for name, unit, prior, most in names
                for axis in "xyz"
            )
        )

    def columns(self, at: Conditions) -> Array:
        """[1, -[y]x] h, (n, 3, 6)."""
        course = course_of(at.time, self.time_constant, self.step_at)
        turn = np.stack([np.cross(axis, at.reading) for axis in np.eye(3)], axis=-1)
        shift = np.broadcast_to(np.eye(3), turn.shape)
        return np.asarray(np.concatenate([shift, turn], axis=-1) * course[:, None, None])

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
