"""Elastic twist of a serial arm's reducers under weight and inertia.

dq = -tau / k
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.demo import Demo
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.springs import DriveCompliance
from delta_calibration.mechanisms import SerialArm


@dataclass(frozen=True)
class ReducerCompliance(DriveCompliance):
    """Elastic twist of each joint's reducer.

    Upright joints, as a SCARA's, bear no weight: there only acceleration reveals the effect.
    """

    cause: ClassVar[str] = "reducer_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "gear",
        "compensate the compliance of the gear, or make it stiffer",
        "hang a known weight on the arm with the motor held and read a dial gauge at its end",
    )
    kind: ClassVar[str] = "structure"
    demo: ClassVar[Demo | None] = Demo("rich", 12)

    @property
    def suits(self) -> bool:
        """Whether the mechanism has links of known mass."""
        arm = self.mechanism
        return isinstance(arm, SerialArm) and arm.heavy(self.robot.masses)

    @property
    def unsuited(self) -> str:
        """Reason: no arm, or one without stated masses."""
        if not isinstance(self.mechanism, SerialArm):
            return super().unsuited
        return f"the robot file of {self.robot.name} does not state the masses of the links"
