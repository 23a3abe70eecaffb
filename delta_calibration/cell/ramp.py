"""Ramps that fade a correction in or out without a jump, and the way back from a hold.

    dq(t) = (1 - s) dq_0 + s dq*,    s = (t - t_0) / ramp, within [0, 1]
    |dq(t) - dq(t - dt)| <= rate dt

dq* is the wanted correction. A new ramp begins at t_0 from dq_0, the correction applied last,
whenever dq* comes from another source (switched on or off, another calibration). If dq* steps
without such a change, as the correction of backlash does at a reversal, the rate limits it.

Each output advances the ramp by one step. If outputs are far apart, the ramp advances by no more
than `at_once_s` between two of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stage:
    """State of a correction on its ramp: value applied, source and time left."""

    applied: Array | float  # (m,) [rad]
    source: object
    left_s: float  # [s]


class Ramp:
    """Ramps and rate-limits the correction applied to the drives.

    Attributes:
        applied: last correction, (m,) [rad]; 0 before the first.
        seconds: length of ramps from the next one on [s].
        rate: largest rate of a joint's correction [rad/s or m/s].
        limited: number of times that the rate limited a correction.
    """

    def __init__(self, seconds: float, rate: float) -> None:
        self.seconds, self.rate = seconds, rate
        self.applied: Array | float = 0.0
        self.source: object = None  # source of the correction, None for none
        self.limited = 0
        self._from: Array | float = 0.0
        self._since_s, self._length = -np.inf, 0.0  # [s]
        self._last_s = -np.inf

    def restart(self) -> None:
        """Start a new ramp at the next output, from the correction that the drives still have."""
        self.source, self._last_s = self, -np.inf

    def is_over(self, source: object) -> bool:
        """Whether the ramp to the correction of this source is complete."""
        return source is self.source and self._last_s >= self._since_s + self._length

    @property
    def last_s(self) -> float:
        """Steady time of the last output [s]; minus infinity before the first."""
        return self._last_s

    @property
    def stage(self) -> Stage:
        """State of the correction applied last."""
        gone_s = max(self._last_s - self._since_s, 0.0)
        return Stage(self.applied, self.source, max(self._length - gone_s, 0.0))

    def resume(self, stage: Stage, now_s: float) -> None:
        """Continue from an earlier stage, at which the drives are again."""
        self.applied = self._from = stage.applied
        self._since_s = self._last_s = now_s
        self._length = stage.left_s
        if stage.source is not self.source:
            self.source = self  # so that the next correction, of any source, starts a new ramp

    def stands(self, applied: Array, now_s: float) -> None:
        """Set the correction that is applied now, (m,) [rad], if it was computed elsewhere."""
        self.applied, self._last_s = applied, now_s

    def toward(
        self, goal: Array, source: object, now_s: float, at_once_s: float = np.inf
    ) -> Array:
        """Return the next correction (m,) [rad] on the way to `goal`, and store it as applied.

        Args:
            goal: wanted correction, (m,) [rad].
            source: source of the goal; a new source starts a ramp.
            now_s: steady time [s].
            at_once_s: longest part [s] of a ramp, or of a rate-limited change, that one output may
                advance; infinite for the points of a trajectory.
        """
        if source is not self.source:
            self.source, self._from = source, self.applied
            self._since_s, self._length = now_s, self.seconds
        elif isfinite(self._last_s):  # a gap in the outputs does not advance the ramp
            self._since_s += max(now_s - self._last_s - at_once_s, 0.0)
        dq = goal
        if now_s < self._since_s + self._length:
            share = max(now_s - self._since_s, 0.0) / self._length
            dq = (1.0 - share) * self._from + share * goal
        if isfinite(self.rate):
            gap = now_s - self._last_s
            step = self.rate * (min(max(gap, 0.0), at_once_s) if isfinite(gap) else gap)
            if max(map(abs, (dq - self.applied).tolist())) > step:
                dq = np.clip(dq, self.applied - step, self.applied + step)
                self.limited += 1
        self._last_s, self.applied = now_s, dq
        return dq


@dataclass(frozen=True)
class WayBack:
    """Linear return of the drives from a hold to the current commands.

    Attributes:
        gap: position of the hold less the wanted one at the start, (m,) [rad].
        seconds: duration [s].
        last_s: steady time of the last output [s].
        gone_s: elapsed part of the duration [s].
    """

    gap: Array
    seconds: float
    last_s: float
    gone_s: float = 0.0

    @classmethod
    def over(cls, gap: Array, now_s: float, seconds: float, speed: float) -> WayBack:
        """Plan a return in `seconds`, or longer if a joint would exceed `speed` [rad/s]."""
        return cls(gap, max(seconds, float(np.abs(gap).max()) / speed), now_s)

    def by(self, now_s: float, at_once_s: float = np.inf) -> WayBack:
        """Advance to the present time, by at most `at_once_s` [s]."""
        step = min(max(now_s - self.last_s, 0.0), at_once_s)
        return replace(self, last_s=now_s, gone_s=self.gone_s + step)

    @property
    def left(self) -> Array:
        """Remaining part of the gap, (m,) [rad]."""
        if self.gone_s >= self.seconds:
            return np.zeros_like(self.gap)
        return self.gap * (1.0 - self.gone_s / self.seconds)
