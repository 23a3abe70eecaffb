"""Drive readings: sense and zero of each drive relative to the model's own joints.

    reading = sense * own + zero        own = sense * (reading - zero)

Everything outside of a mechanism's laws uses readings: topics, limits, commands, effects,
derivatives, torques. The laws use the mechanism's own joints. The conversion happens in the
compiled loops, which put a law's joints into its workspace and take its derivatives by them out
(model/kernels.py), and in `start_joints` where it is a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drives:
    """Sense (m,), 1 or -1, and zero (m,) [rad or m]: the reading at which the own joint is 0."""

    sense: Array
    zero: Array

    @classmethod
    def alike(cls, joints: int) -> Drives:
        """Drives that read the mechanism's own joints."""
        return cls(np.ones(joints), np.zeros(joints))

    def own(self, reading: Array) -> Array:
        """Convert readings to the mechanism's own joints, (..., m)."""
        return self.sense * (reading - self.zero)

    def read(self, own: Array) -> Array:
        """Convert the mechanism's own joints to readings, (..., m)."""
        return self.sense * own + self.zero
