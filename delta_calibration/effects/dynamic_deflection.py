"""Deflection of drives by the inertia that they accelerate, but not by weight.

dq = -J^T M a / k

A controller with integral action compensates steady loads and yields to quick ones. A spring
yields to both: joint_compliance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Stage
from delta_calibration.effects.regressor import ACCELERATION, Regressor
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import INERTIA
from delta_calibration.effects.springs import GIVE, MOST_GIVE, LoadEffect
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class DynamicDeflection(LoadEffect):
    """Deflection of the drives by the load that accelerates all masses and the payload."""

    cause: ClassVar[str] = "dynamic_deflection"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drives",
        "compensate the deflection, or accelerate less",
        "drive the same circle at half the speed: the deviation falls to a quarter",
    )
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.DRIVE
    gentle: ClassVar[bool] = True

    @property
    def parameters(self) -> ParameterSet:
        """1/k [rad/(N m), m/N], the same for all joints."""
        unit, size = self._of_joints("rad/(N m)")
        return self.shared("dynamic_compliance", unit, size * GIVE, 0.0, size * MOST_GIVE)

    def regressor(self, at: Conditions) -> Regressor:
        """Acceleration of the joint."""
        del at
        return ACCELERATION

    takes: ClassVar[tuple[str, ...]] = (INERTIA,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-J^T M a / k."""
        del c
        return -v[0] * s[0]
