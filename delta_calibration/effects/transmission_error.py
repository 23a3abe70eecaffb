"""Transmission error of gears: a periodic error with many cycles per turn of the joint.

dq = a sin(n q) + b cos(n q)        q unwrapped; n of the gear: 1x and 2x of a motor turn

Teeth and wave generators cause it. A gear train with an error once per motor turn mostly has one
twice per turn as well: a second order of the same train may exist besides the order found first.
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
    """A harmonic of `cycles` per turn of the joint, equal for all joints, and a second one.

    Of a joint that slides, `cycles` is per 2 pi m; a verdict tells cycles per metre.
    """

    cause: ClassVar[str] = "transmission_error"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "gear",
        "compensate the transmission error of the gear",
        "turn the motor twice, in ten steps per turn, and measure the joint at each step: the "
        "error repeats",
    )
    told: ClassVar[Mapping[str, tuple[str, str]]] = {"cycles": ("order", "1")}
    limits: ClassVar[Limits] = {"cycles": (0.1, 1e5), "second": (0.0, 16.0)}
    live_strength: ClassVar[float] = 0.8
    repeats: ClassVar[bool] = True
    again_at_one_place: ClassVar[bool] = True  # waves of all joints can imitate any structure

    cycles: float = 33.0
    second: float = 0.0  # second order, in multiples of `cycles`; 0 if there is none

    @property
    def suits(self) -> bool:
        """Whether the joints may have gears; a winch turns too often for a search."""
        return self.mechanism.limb == "joint"

    @property
    def parameters(self) -> ParameterSet:
        """a and b of each joint and order [rad]: harmonic drives 0.5 to 2 arc minutes."""
        return self.waves(0.15e-3, 0.01, len(self.orders))

    @property
    def orders(self) -> tuple[float, ...]:
        """Cycles per turn of the joint, for each harmonic."""
        return (self.cycles, self.second * self.cycles) if self.second else (self.cycles,)

    @property
    def order(self) -> float | None:
        """Order of the harmonic if there is only one; else None."""
        return None if self.second else self.cycles

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """Once per turn of the motor: the gear ratio of the robot file."""
        del thermometers
        return {"cycles": self.robot.joints.gear_ratio}

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """One and two times the gear ratio; then all orders that the joints' range can separate.

        A range R of the joint separates harmonics whose orders differ by about 2 pi / R cycles or
        more; the step of the search is three eighths of that. An order that repeats less than
        three times over the range could be any curve and is tried only if it is the gear's own.
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
        """Each shape of the search, and this one with a second order of its gear train.

        The slower of both orders must repeat a few times in the joints' range: if it repeats less
        often, two orders could fit any curve.
        """
        yield from self.shapes(at)
        turns = float(np.ptp(at.joint, axis=0).max()) / (2 * np.pi)
        for second in _OF_A_TRAIN:
            if min(1.0, second) * self.cycles * turns >= _REPEATS:
                yield replace(self, second=second)

    def apart(self, other: Effect) -> bool:
        """Whether the orders are those of two gears: joints may have unlike ones."""
        if not isinstance(other, TransmissionError):
            return False
        least = 2 * _BETWEEN / self.mechanism.joint_size
        return all(abs(a - b) > least for a in self.orders for b in other.orders)

    def as_told(self, name: str) -> tuple[str, str, float]:
        """Also convert the order of a sliding joint, whose own is [rad/m], to cycles per metre."""
        label, unit, factor = super().as_told(name)
        if self.mechanism.joint_unit == "m":
            return label, "1/m", factor / (2 * np.pi)
        return label, unit, factor

    @property
    def chosen(self) -> dict[str, str]:
        """The second order, if one was found."""
        return {"second_order": f"{self.second:g} times the order"} if self.second else {}

    def intervals(self) -> tuple[Interval, ...]:
        """Searched fields, each between its neighbours in the search."""
        size = self.mechanism.joint_size
        low = max(_LEAST_CYCLES / size, self.cycles - _BETWEEN / size)
        return (("cycles", low, self.cycles + _BETWEEN / size),)


_LEAST_CYCLES, _SLOWEST, _MOST_CYCLES = 0.1, 8.0, 260.0  # per turn of a Delta's joint
_BETWEEN = 1.5  # half width of the interval of `cycles`
_FEWEST = 3.0  # least repetitions of a wave over the joints' range
_OF_A_TRAIN = (2.0, 0.5, 4.0, 0.25)  # second orders to try
_REPEATS = 4.0  # least repetitions of the slower of two orders
