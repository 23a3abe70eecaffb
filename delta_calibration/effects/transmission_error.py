"""Teeth and wave generators: an error that repeats many times a turn.

dq = a sin(n q) + b cos(n q)        q unwrapped; n of the gear: 1x and 2x of a motor turn
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Interval, Limits, Stage, diagonal
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class TransmissionError(Effect):
    """A harmonic of `cycles` a turn of the joint, the same for all joints."""

    cause: ClassVar[str] = "transmission_error"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    limits: ClassVar[Limits] = {"cycles": (0.1, 1e5)}

    cycles: float = 33.0

    @property
    def suits(self) -> bool:
        """Whether a joint is moved by a gear; a winch turns too often for a search."""
        return self.mechanism.limb == "joint"

    @property
    def parameters(self) -> ParameterSet:
        """a and b of each joint [rad]: harmonic drives 0.5 to 2 arc minutes."""
        sine = self.each_joint("sine", "rad", 0.15e-3, -0.01, 0.01)
        return sine + self.each_joint("cosine", "rad", 0.15e-3, -0.01, 0.01)

    def columns(self, at: Conditions) -> Array:
        """(n, m, 2 m)."""
        phase = self.cycles * at.joint
        return np.concatenate([diagonal(np.sin(phase)), diagonal(np.cos(phase))], axis=-1)

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """The file's gear once and twice; then all that the joints' range can part.

        Two harmonics part over a range R of the joint from about 2 pi / R cycles on; three eighths
        of that is the step of the search. Beneath a few cycles over the range it is eccentricity.
        """
        gear = self.robot.joints.gear_ratio
        yield replace(self, cycles=gear)
        yield replace(self, cycles=2 * gear)
        span = float(np.ptp(at.joint, axis=0).max())
        if span <= 0:
            return
        step = 0.75 * np.pi / span
        size = self.mechanism.joint_size
        least = max(_SLOWEST / size, 4 * np.pi / span)
        for cycles in np.arange(least, _MOST_CYCLES / size, step).tolist():
            yield replace(self, cycles=cycles)


    def intervals(self) -> tuple[Interval, ...]:
        """Between the neighbours of the search."""
        return (("cycles", max(_LEAST_CYCLES, self.cycles - _BETWEEN), self.cycles + _BETWEEN),)


_LEAST_CYCLES, _SLOWEST, _MOST_CYCLES = 0.1, 8.0, 260.0  # a turn of a Delta's joint
_BETWEEN = 1.5
