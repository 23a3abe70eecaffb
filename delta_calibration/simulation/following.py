"""Motion of joints that follow one command after another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Stroke

Array = NDArray[np.float64]

_WINDOW = 0.1  # [s] over which speeds are derived where commands are denser
_FEWEST = 3  # number of commands that a parabola needs
_LEAST = 1e-9  # [rad] smallest reversal: commands have no noise, and backlash acts at once
_GAP = 0.25  # [s] no speed is derived across a longer pause


@dataclass(frozen=True)
class Following:
    """Speed, acceleration, direction and travel of joints, updated at every command."""

    strokes: tuple[Stroke, ...]
    last: tuple[tuple[float, Array], ...] = ()  # commands: time [s], joints (m,) [rad]

    @classmethod
    def standing(cls, joint: Array) -> Following:
        """Return the state of joints (m,) [rad] that have not moved yet."""
        return cls(tuple(Stroke(angle, least=_LEAST) for angle in joint.tolist()))

    def moved(self, joint: Array, time: float) -> Following:
        """Return the state after a command to angles (m,) [rad] at a time [s]."""
        pairs = zip(self.strokes, joint.tolist(), strict=True)
        strokes = tuple(stroke.moved(angle) for stroke, angle in pairs)
        connected = bool(self.last) and 0 < time - self.last[-1][0] <= _GAP
        last = (*(self.last if connected else ()), (time, joint))
        while len(last) > _FEWEST and last[0][0] < time - _WINDOW:
            last = last[1:]
        return Following(strokes, last)

    def stopped(self) -> Following:
        """Return the state at rest at the last command."""
        return Following(self.strokes, self.last[-1:])

    def derivatives(self) -> tuple[Array, Array]:
        """Speed and acceleration at the last command, (m,) each, from a fitted parabola."""
        nothing = np.zeros(len(self.strokes))
        if len(self.last) < _FEWEST or np.array_equal(self.last[-1][1], self.last[-2][1]):
            return nothing, nothing
        time = np.array([when for when, _ in self.last])
        joint = np.array([angles for _, angles in self.last])
        # About the last command, and in units of the whole time: well conditioned at any rate.
        span = time[-1] - time[0]
        share = (time - time[-1]) / span
        powers = np.stack([np.ones_like(share), share, share**2], axis=1)
        fitted = np.linalg.lstsq(powers, joint - joint[-1], rcond=None)[0]
        return fitted[1] / span, 2 * fitted[2] / span**2

    def direction(self) -> Array:
        """Sign of each joint's last motion, 0 before the first, (m,)."""
        return np.array([stroke.direction for stroke in self.strokes])

    def travel(self, joint: Array) -> Array:
        """Distance of joints at angles (m,) [rad] from their last reversal, (m,) [rad]."""
        pairs = zip(self.strokes, joint.tolist(), strict=True)
        return np.array([stroke.travel(angle) for stroke, angle in pairs])
