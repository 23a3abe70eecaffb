"""Temperatures of the parts of a simulated cell.

    T = 20 deg C + rise (1 - exp(-t / tau))

Without warming all parts stay at 20 deg C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects.time_course import WARM_UP

Array = NDArray[np.float64]

AMBIENT = 20.0  # [deg C]
PARTS = ("arm", "base")  # parts that carry a thermometer

_RISE = np.array([13.0, 5.5])  # [K] final; after two hours the base's rise is a third of the arms'
_PACE = np.array([1.0, 2.0])  # time constants relative to the arms': the base plate is heavier


@dataclass(frozen=True)
class Climate:
    """Temperatures of a cell that was switched on at time zero."""

    warming: bool = False
    time_constant: float = WARM_UP  # [s] of the arms

    def celsius(self, time: Array) -> Array:
        """Temperature of each of PARTS at times (n,) [s], (n, parts) [deg C]."""
        share = -np.expm1(-time[:, None] / (self.time_constant * _PACE))
        return np.asarray(AMBIENT + self.warming * _RISE * share)
