"""Tracker and joints stamped by clocks that differ.

dy = -(dy/dt) T           nothing at rest
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class TimestampLatency(Effect):
    """A reading belongs to where the platform was T before its stamp says."""

    cause: ClassVar[str] = "timestamp_latency"
    kind: ClassVar[str] = "measurement"
    stage: ClassVar[Stage] = Stage.MEASUREMENT
    outside: ClassVar[str] = "log the joints' measured angles beside the commanded ones"

    @property
    def parameters(self) -> ParameterSet:
        """T [s], either sign."""
        return self.shared("latency", "s", 5e-3, -0.1, 0.1)

    def columns(self, at: Conditions) -> Array:
        """Minus the reading's speed, (n, 3, 1) [m/s]."""
        return -at.reading_velocity[:, :, None]
