"""Corrections that come and go without a jump, and the way back from a hold.

    dq(t) = (1 - s) dq_0 + s dq*,    s = (t - t_0) / ramp, within [0, 1]
    |dq(t) - dq(t - dt)| <= rate dt

dq* is the correction that is wanted. A new ramp begins at t_0 from dq_0, the correction applied
last, whenever dq* comes from another source (switched on or off, another calibration). Where it
steps without that, as that of a play does when the motion turns round, the rate holds it.

Drives that are given a ramp in steps take one step an output: where outputs are far apart no more
time passes between them than `at_once_s`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stage:
    """A correction on its way: what is applied (m,) [rad], from what, what is left of the ramp."""

    applied: Array | float
    source: object
    left_s: float  # [s]


class Ramp:
    """The correction that the drives are given.

    Attributes:
        applied: the last one, (m,) [rad]; 0 before the first.
        seconds: length of ramps from the next one on [s].
        rate: fastest change of a joint's correction [rad/s or m/s].
        limited: how often the rate held a correction back.
    """

    def __init__(self, seconds: float, rate: float) -> None:
        self.seconds, self.rate = seconds, rate
        self.applied: Array | float = 0.0
        self.source: object = None  # what the correction comes from, None for none
        self.limited = 0
        self._from: Array | float = 0.0
        self._since_s, self._length = -np.inf, 0.0  # [s]
        self._last_s = -np.inf

    def restart(self) -> None:
        """Begin anew from the correction that the drives still have, however long ago it was."""
        self.source, self._last_s = self, -np.inf

    def is_over(self, source: object) -> bool:
        """Whether the correction of this source has come in whole by now."""
        return source is self.source and self._last_s >= self._since_s + self._length

    @property
    def last_s(self) -> float:
        """Steady time of the last output [s]; minus infinity before the first."""
        return self._last_s

    @property
    def stage(self) -> Stage:
        """How far the correction has come that was applied last."""
        gone_s = max(self._last_s - self._since_s, 0.0)
        return Stage(self.applied, self.source, max(self._length - gone_s, 0.0))

    def resume(self, stage: Stage, now_s: float) -> None:
        """Go on from an earlier stage, which the drives are at again."""
        self.applied = self._from = stage.applied
        self._since_s = self._last_s = now_s
        self._length = stage.left_s
        if stage.source is not self.source:
            self.source = self  # anew, wherever to

    def stands(self, applied: Array, now_s: float) -> None:
        """Take notice of how far the correction has come by now, (m,) [rad], on its ramp."""
        self.applied, self._last_s = applied, now_s

    def toward(
        self, goal: Array, source: object, now_s: float, at_once_s: float = np.inf
    ) -> Array:
        """The correction (m,) [rad] at a time where `goal` is wanted; it counts as applied.

        Args:
            goal: the correction that is wanted.
            source: what it comes from.
            now_s: steady time.
            at_once_s: time [s] of a ramp, or of a correction at its rate, that one step of the
                drives makes up for; a point of a trajectory is no step.
        """
        if source is not self.source:
            self.source, self._from = source, self.applied
            self._since_s, self._length = now_s, self.seconds
        elif isfinite(self._last_s):  # on its way: a gap in the outputs is none in the ramp
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
    """From where the drives were held to where the commands are by then.

    Attributes:
        gap: where they were held less where they are wanted, (m,) [rad].
        seconds: how long it takes [s].
        last_s: of the last output, steady time [s].
        gone_s: how much of it is over [s].
    """

    gap: Array
    seconds: float
    last_s: float
    gone_s: float = 0.0

    @classmethod
    def over(cls, gap: Array, now_s: float, seconds: float, speed: float) -> WayBack:
        """In `seconds`, or as long as it takes at no more than `speed` [rad/s] of a joint."""
        return cls(gap, max(seconds, float(np.abs(gap).max()) / speed), now_s)

    def by(self, now_s: float, at_once_s: float = np.inf) -> WayBack:
        """As far as it is by now, no farther in one output than `at_once_s` [s] of it."""
        step = min(max(now_s - self.last_s, 0.0), at_once_s)
        return replace(self, last_s=now_s, gone_s=self.gone_s + step)

    @property
    def left(self) -> Array:
        """What there is still to go, (m,) [rad]."""
        if self.gone_s >= self.seconds:
            return np.zeros_like(self.gap)
        return self.gap * (1.0 - self.gone_s / self.seconds)
