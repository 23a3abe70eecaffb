"""Play between motor and arm: half the gap behind, whichever way the joint last went.

    dq = -(gap / 2) play(direction, travel)

The play crosses over the first `width` of travel after a turn, and stays at its end then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Stage, diagonal
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class Backlash(Effect):
    """Lost motion of each joint."""

    cause: ClassVar[str] = "backlash"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    needs: ClassVar[tuple[str, ...]] = ("direction",)

    width: tuple[float, ...] = ()  # (m,) [rad] of travel over which the play is crossed

    @property
    def parameters(self) -> ParameterSet:
        """Gap of each joint [rad]: planetary gears 1 to 5 arc minutes, RV 1, harmonic under 1."""
        return self.each_joint("gap", "rad", 0.3e-3, 0.0, 0.05)

    def columns(self, at: Conditions) -> Array:
        """(n, m, m)."""
        width = np.clip(self.width or np.zeros(at.travel.shape[1]), _LEAST, None)
        crossed = np.clip(2 * at.travel / width - 1, -1.0, 1.0)
        return diagonal(-at.direction * crossed / 2)

    def wrong(self) -> str:
        """A width for each joint or none, none of them negative."""
        joints = self.mechanism.joints
        if len(self.width) in (0, joints) and all(0 <= value < np.inf for value in self.width):
            return ""
        return f"width: {self.width} is not allowed; none, or {joints} of 0 or more"

    def refined(self, values: Array) -> Backlash:
        """A play is crossed over its own gap."""
        return replace(self, width=tuple(np.clip(values, 0.0, None).tolist()))


_LEAST = 1e-9  # [rad]
