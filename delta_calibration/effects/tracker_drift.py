"""Drift of the tracker's stand or zero: a small rigid motion of all readings over time.

dy = (t + w x y) h(time)
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Setting, Stage
from delta_calibration.effects.remedy import MEASURE, Remedy
from delta_calibration.effects.signals import READING, TIME
from delta_calibration.effects.time_course import WARM_UP, Drift, course
from delta_calibration.model.symbols import Symbol, cross
from delta_calibration.parameters import Parameter, ParameterSet


@dataclass(frozen=True)
class TrackerDrift(Drift):
    """Rigid drift; h is a ramp, a settling, a step or a cycle."""

    cause: ClassVar[str] = "tracker_drift"
    remedy: ClassVar[Remedy] = Remedy(
        MEASURE,
        "tracker",
        "let the tracker warm up, fix its stand, and measure again",
        "measure a reflector that is fixed to the floor before, during and after the session",
    )
    kind: ClassVar[str] = "measurement"
    stage: ClassVar[Stage] = Stage.MEASUREMENT
    outside: ClassVar[str] = "measure three reflectors fixed to the floor, every ten minutes"
    alone: ClassVar[tuple[tuple[str, ...], ...]] = (("shift_x", "shift_y", "shift_z"),)

    @property
    def parameters(self) -> ParameterSet:
        """Shift t [m] and turn w [rad]: per hour, or of the settling, the step or the cycle.

        Heat moves a stand by 2 mm at most. A step is a stand that was pushed: ten times as far,
        and up to 50 mm as long as its turn is small enough for the linear law. A tracker set up
        anew is a mistake in the session (`delta-cal check`).
        """
        shift, turn = (30e-6, 2e-3), (10e-6, 1e-3)
        if self.step_at >= 0:
            shift, turn = (300e-6, 50e-3), (100e-6, 5e-3)
        names = [("shift", "m", *shift), ("turn", "rad", *turn)]
        return ParameterSet(
            tuple(
                Parameter(f"{name}_{axis}", unit, 0.0, prior, self.cause, None, -most, most)
                for name, unit, prior, most in names
                for axis in "xyz"
            )
        )

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """Settling with the machine's warm-up, as the stand warms up with it."""
        del thermometers
        return {"time_constant": WARM_UP}

    takes: ClassVar[tuple[str, ...]] = (
        READING,
        TIME,
    )

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """(t + w x y) h(time)."""
        return (v[0:3] + cross(v[3:6], s[0:3])) * course(s[3], c[0], c[1], c[2], c[3])
