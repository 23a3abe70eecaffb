"""How the drives read: sense and zero of each joint beside those of the model.

    reading = sense * own + zero        own = sense * (reading - zero)

Everything outside of a mechanism's laws speaks of readings: topics, limits, commands, effects,
derivatives, torques. The laws are written in the mechanism's own joints. They meet in the compiled
loops, where a law's joints are put into its workspace and its slopes by them are taken out
(model/kernels.py), and where `start_joints` is a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drives:
    """Sense (m,), 1 or -1, and zero (m,) [rad or m]: the reading where the own joint is zero."""

    sense: Array
    zero: Array

    @classmethod
    def alike(cls, joints: int) -> Drives:
        """Drives that read the mechanism's own joints."""
        return cls(np.ones(joints), np.zeros(joints))

    def own(self, reading: Array) -> Array:
        """The mechanism's own joints at these readings, (..., m)."""
        return self.sense * (reading - self.zero)

    def read(self, own: Array) -> Array:
        """What the drives read at the mechanism's own joints, (..., m)."""
        return self.sense * own + self.zero
