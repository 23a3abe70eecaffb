"""Base of the effects by which a quantity trails in time.

dy = -T dy/dt + b T^2 d2y/dt2        b = 1/2 after a pure delay, 1 behind a filter of first order

Both are the first terms of a series: of y(t - T), and of y behind a filter with the time constant
T. A moving average that ends at the stamp lies between them (2/3), a reading that is extrapolated
to its stamp below. b is not searched with the cause but compared once the cause was found.

The inverse of the series, y + T dy/dt + (1 - b) T^2 d2y/dt2 with the derivatives of the wanted y,
is the command that undoes it: the same law with b - 1, solved backward.

The third term of the series, c T^3 d3y/dt3 with c = 0, 1/6 and 1 for b = 0, 1/2 and 1, is left
out: no recorded signal holds the derivative. Differences of the second one show how far the term
may move T, by which the stated interval is widened.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array, Effect, Limits
from delta_calibration.effects.signals import TIME, Signals
from delta_calibration.parameters import ParameterSet

_KINDS = (0.0, 0.5, 1.0)  # b if extrapolated, delayed, filtered
_NEAR = 0.5  # [s] readings farther apart belong to different motions
_SLIGHT = 5e-3  # of the first term: a second term as small as this is not worth a comparison


@dataclass(frozen=True)
class Delay(Effect):
    """A quantity follows another with a delay or a time constant T."""

    limits: ClassVar[Limits] = {"second_order": (0.0, 1.0)}

    second_order: float = 0.5  # b
    times: tuple[float, ...] = ()  # [s] T for which the second term is computed; none: without it

    def constants(self, joint: int) -> tuple[float, ...]:
        """Factor b T of the second derivative in the parentheses of the law [s]."""
        return (self.second_order * self.times[joint] if self.times else 0.0,)

    @property
    def undone(self) -> Effect:
        """The same law with b - 1, because the wanted motion has other derivatives."""
        return self._with(second_order=self.second_order - 1.0)

    def refined(self, values: Array) -> Effect:
        """The same effect with the times found."""
        return self._with(times=tuple(np.asarray(values).tolist()))

    def refinements(self, at: Conditions) -> Iterator[Effect]:
        """The other ways to trail, if the motions are quick enough to show the difference."""
        yield self
        speed, change = (float(np.sum(v**2)) for v in (at.velocity, at.acceleration))
        longest = max(map(abs, self.times), default=0.0)
        if longest**2 * change > _SLIGHT**2 * speed:
            others = (kind for kind in _KINDS if kind != self.second_order)
            yield from (self._with(second_order=kind) for kind in others)

    def wrong(self) -> str:
        """Also check that `times` is empty or has one number for each value."""
        count = len(self.parameters)
        if wrong := super().wrong():
            return wrong
        if len(self.times) in (0, count) and all(np.isfinite(self.times)):
            return ""
        return f"times: {self.times} is not allowed; none, or {count} of them"

    def _with(self, **fields: Any) -> Effect:
        other: Effect = replace(self, **fields)
        return other


@dataclass(frozen=True)
class ThirdTerm(Effect):
    """The third term of a delay's series, which the law of the delay leaves out."""

    cause: ClassVar[str] = "third_term"
    kind: ClassVar[str] = "measurement"

    delay: Delay

    @property
    def parameters(self) -> ParameterSet:
        """Times of the delay."""
        return self.delay.parameters

    def columns_of(
        self, signals: Signals, values: Array | None = None, by_stage: Array | None = None
    ) -> Array:
        """See `Effect.columns_of`: c T^2 d3y/dt3, (n, d, k) [m/s, rad/s]; needs whole sessions."""
        b, times = self.delay.second_order, np.array(self.delay.times or (0.0,))
        third = (4 * b**2 - b) / 3 * times**2 * _slope(signals, self.delay.takes[-1])
        one = len(self.parameters) == 1
        own = third[:, :, None] if one else third[:, :, None] * np.eye(len(self.parameters))
        return np.asarray(own if by_stage is None else by_stage @ own)


def _slope(signals: Signals, name: str) -> Array:
    """Derivative of a signal by time, (n, d), from readings near in time; 0 where there are none.

    From the reading before to the one after, or to the only one of them that is near.
    """
    order = np.argsort(signals.of(TIME)[:, 0])
    time, value = signals.of(TIME)[order], signals.of(name)[order]
    step, rise = np.diff(time, axis=0), np.diff(value, axis=0)
    near = step < _NEAR
    step, rise = (np.pad(near * change, ((1, 1), (0, 0))) for change in (step, rise))
    step, rise = step[1:] + step[:-1], rise[1:] + rise[:-1]
    result = np.empty_like(value)
    result[order] = np.divide(rise, step, out=np.zeros_like(rise), where=step > 0)
    return result
