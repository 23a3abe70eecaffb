"""Teeth and wave generators: an error that repeats many times a turn.

dq = a sin(n q) + b cos(n q)        q unwrapped; n of the gear: 1x and 2x of a motor turn

A train that errs once a turn of the motor mostly does so twice as well: beside the order that is
found first, another of the same train may be.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import (
    Effect,
    Interval,
    Limits,
    Setting,
)
from delta_calibration.effects.harmonic import HarmonicEffect
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class TransmissionError(HarmonicEffect):
    """A harmonic of `cycles` a turn of the joint, the same for all joints, and one beside it."""

    cause: ClassVar[str] = "transmission_error"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "gear",
        "compensate the gear's ripple",
        "turn the motor once in ten steps and measure the joint at each: the error repeats",
    )
    told: ClassVar[Mapping[str, tuple[str, str]]] = {"cycles": ("order", "1")}
    limits: ClassVar[Limits] = {"cycles": (0.1, 1e5), "second": (0.0, 16.0)}
    live_strength: ClassVar[float] = 0.8

    cycles: float = 33.0
    second: float = 0.0  # order beside it, in multiples of `cycles`; 0 where there is none

    @property
    def suits(self) -> bool:
        """Whether a joint is moved by a gear; a winch turns too often for a search."""
        return self.mechanism.limb == "joint"

    @property
    def parameters(self) -> ParameterSet:
        """a and b of each joint and order [rad]: harmonic drives 0.5 to 2 arc minutes."""
        return self.waves(0.15e-3, 0.01, len(self.orders))

    @property
    def orders(self) -> tuple[float, ...]:
        """Cycles a turn of the joint of each harmonic."""
        return (self.cycles, self.second * self.cycles) if self.second else (self.cycles,)

    @property
    def order(self) -> float | None:
        """That of the only harmonic."""
        return None if self.second else self.cycles

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """Once a turn of the motor: the gear of the robot's file."""
        del thermometers
        return {"cycles": self.robot.joints.gear_ratio}

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """The file's gear once and twice; then all that the joints' range can part.

        Two harmonics part over a range R of the joint from about 2 pi / R cycles on; three eighths
        of that is the step of the search. What repeats less than three times over the range could
        be any curve; the file's own gear is known.
        """
        gear = self.robot.joints.gear_ratio
        yield replace(self, cycles=gear)
        yield replace(self, cycles=2 * gear)
        span = float(np.ptp(at.joint, axis=0).max())
        if span <= 0:
            return
        step = 0.75 * np.pi / span
        size = self.mechanism.joint_size
        least = max(_SLOWEST / size, 2 * np.pi * _FEWEST / span)
        for cycles in np.arange(least, _MOST_CYCLES / size, step).tolist():
            yield replace(self, cycles=cycles)

    def refinements(self, at: Conditions) -> Iterator[Effect]:
        """Each shape of the search, and this one with another order of its train beside it.

        Where the slower of both repeats a few times in the joints' range: less often, two orders
        could draw any curve.
        """
        yield from self.shapes(at)
        turns = float(np.ptp(at.joint, axis=0).max()) / (2 * np.pi)
        for second in _OF_A_TRAIN:
            if min(1.0, second) * self.cycles * turns >= _REPEATS:
                yield replace(self, second=second)

    @property
    def chosen(self) -> dict[str, str]:
        """The order beside the first, where one was found."""
        return {"second_order": f"{self.second:g} times the order"} if self.second else {}

    def intervals(self) -> tuple[Interval, ...]:
        """Between the neighbours of the search."""
        size = self.mechanism.joint_size
        low = max(_LEAST_CYCLES / size, self.cycles - _BETWEEN / size)
        return (("cycles", low, self.cycles + _BETWEEN / size),)


_LEAST_CYCLES, _SLOWEST, _MOST_CYCLES = 0.1, 8.0, 260.0  # a turn of a Delta's joint
_BETWEEN = 1.5
_FEWEST = 3.0  # times that a wave repeats over the joints' range
_OF_A_TRAIN = (2.0, 0.5, 4.0, 0.25)
_REPEATS = 4.0  # times in the joints' range
