"""Base of the effects by which a quantity trails in time.

dy = -T dy/dt + b T^2 d2y/dt2        b = 1/2 after a pure delay, 1 behind a filter of first order

Both are the first terms of a series: of y(t - T), and of y behind a filter with the time constant
T. A moving average that ends at the stamp lies between them (2/3), a reading that is extrapolated
to its stamp below. b is not searched with the cause but compared once the cause was found.

The inverse of the series, y + T dy/dt + (1 - b) T^2 d2y/dt2 with the derivatives of the wanted y,
is the command that undoes it: the same law with b - 1, solved backward.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array, Effect, Limits

_KINDS = (0.0, 0.5, 1.0)  # b if extrapolated, delayed, filtered
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
