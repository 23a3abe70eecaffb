"""How warm the parts of a simulated cell are.

    T = 20 deg C + rise (1 - exp(-t / tau))

Steady at 20 deg C where nothing warms them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects.time_course import WARM_UP

Array = NDArray[np.float64]

AMBIENT = 20.0  # [deg C]
PARTS = ("arm", "base")  # that carry a thermometer

_RISE = np.array([13.0, 5.5])  # [K] in the end: after two hours the base is at a third of the arms
_PACE = np.array([1.0, 2.0])  # time constants in that of the arms: the base plate is heavier


@dataclass(frozen=True)
class Climate:
    """Temperatures of a cell that was switched on at time zero."""

    warming: bool = False
    time_constant: float = WARM_UP  # [s] of the arms

    def celsius(self, time: Array) -> Array:
        """Of each of PARTS at times (n,) [s], (n, parts) [deg C]."""
        share = -np.expm1(-time[:, None] / (self.time_constant * _PACE))
        return np.asarray(AMBIENT + self.warming * _RISE * share)
