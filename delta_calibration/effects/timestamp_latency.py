"""Time offset between the clocks of tracker and joints.

dy = -T dy/dt + T^2 / 2 d2y/dt2           nothing at rest
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.delay import Delay, ThirdTerm
from delta_calibration.effects.regressor import READING_SPEED, Regressor
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import READING_ACCELERATION, READING_RATE
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class TimestampLatency(Delay):
    """A reading shows the platform as it was a time T before the reading's stamp."""

    cause: ClassVar[str] = "timestamp_latency"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "clocks",
        "synchronise the clocks of controller and tracker",
        "move one joint back and forth at two speeds: the error doubles with the speed",
    )
    kind: ClassVar[str] = "measurement"
    stage: ClassVar[Stage] = Stage.MEASUREMENT
    outside: ClassVar[str] = "log the measured joint angles in addition to the commanded ones"
    takes: ClassVar[tuple[str, ...]] = (READING_RATE, READING_ACCELERATION)

    @property
    def parameters(self) -> ParameterSet:
        """T [s], either sign."""
        return self.shared("latency", "s", 5e-3, -0.1, 0.1)

    def regressor(self, at: Conditions) -> Regressor:
        """Speed of the reflector."""
        del at
        return READING_SPEED

    def doubt(self) -> Effect:
        """The third term of the series."""
        return _ThirdTerm(self.robot, self.mechanism, self)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-T dy/dt + b T^2 d2y/dt2, one T of the second term being a constant."""
        return v[0] * (c[0] * s[3:6] - s[0:3])


@dataclass(frozen=True)
class _ThirdTerm(ThirdTerm):
    stage: ClassVar[Stage] = Stage.MEASUREMENT
