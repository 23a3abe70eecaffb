"""Reducers of a serial arm that twist under what they accelerate and hold.

dq = -tau / k
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.demo import Demo
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import GRAVITY, INERTIA
from delta_calibration.mechanisms import SerialArm
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class ReducerCompliance(Effect):
    """Elastic twist of each joint's reducer.

    Joints that stand upright, as a SCARA's, bear no weight: there it shows by acceleration only.
    """

    cause: ClassVar[str] = "reducer_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "gear",
        "compensate the gear's give, or make it stiffer",
        "hang a known weight on the arm with the motor held and read a dial gauge at its end",
    )
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.DRIVE
    gentle: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    demo: ClassVar[Demo | None] = Demo("rich", 12)

    @property
    def suits(self) -> bool:
        """Whether the mechanism has links of known mass."""
        arm = self.mechanism
        return isinstance(arm, SerialArm) and any(link.mass for link in arm.dimensions.links)

    @property
    def parameters(self) -> ParameterSet:
        """1/k of each joint [rad/(N m)]: reducers of such arms have 1e4 to 1e5 N m/rad."""
        return self.each_joint("compliance", "rad/(N m)", 4e-5, 0.0, 1e-2)

    takes: ClassVar[tuple[str, ...]] = (
        GRAVITY,
        INERTIA,
    )

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-tau / k, of weight and of inertia."""
        del c
        return -v[0] * (s[0] + s[1])
