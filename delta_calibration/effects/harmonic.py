"""Base of the effects that repeat periodically over a joint's angle.

dq = sum over orders n of a_n sin(n q) + b_n cos(n q)
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.signals import JOINT, Places
from delta_calibration.model.symbols import Symbol, cos, sin
from delta_calibration.model.terms import Term


@dataclass(frozen=True)
class HarmonicEffect(Effect):
    """Waves of each joint's own angle, with amplitudes in the order of `waves`."""

    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @property
    @abstractmethod
    def orders(self) -> tuple[float, ...]:
        """Angular frequency n of each wave by the joint's coordinate [1/rad or 1/m]."""

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """a sin(n q) + b cos(n q) of one order n."""
        phase = c[0] * s[0]
        return v[0] * sin(phase) + v[1] * cos(phase)

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per order and joint, with a sine and a cosine."""
        count, first = self.mechanism.joints, places.begin(JOINT)
        for wave, order in enumerate(self.orders):
            for joint in range(count):
                sine = 2 * wave * count + joint
                yield Term((first + joint,), (sine, sine + count), (joint,), (order,))
