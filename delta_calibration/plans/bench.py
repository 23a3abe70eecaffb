"""What can be varied at the stops of a plan, and what of it moves the readings.

Found out, not listed: the side of the approach, the payload, the warmth and the motion are varied
where the columns of a cause change with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions, at_rest
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.predicted_information import Samples
from delta_calibration.diagnosis.shared_path_error import AT_REST
from delta_calibration.plans.motion import APPROACH, MotionPath

Array = NDArray[np.float64]

_SENSORS = ("arm", "base")  # where nothing was measured before
_AMBIENT = 20.0  # [deg C]
# Warming up for an hour, then cooling for another: [s] and [K] above the beginning.
SLOTS = ((0.0, 0.0), (1800.0, 7.0), (3600.0, 10.0), (5400.0, 4.0), (7200.0, 1.5))
_WARMEST = 2
_MATTERS = 1e-6  # share of a column by which it changes
_SPEED, _ACCELERATION = 0.5, 5.0  # [rad/s], [rad/s^2] of a Delta's brisk motion
_ALONG = 48  # samples of a path that are looked at


@dataclass(frozen=True)
class StopConditions:
    """Conditions of a stop that a plan can choose."""

    side: float = 1.0  # +1 or -1
    payload: float = 0.0  # [kg]
    slot: int = 0  # of the warming and cooling


PLAIN = StopConditions()


@dataclass(frozen=True)
class Bench:
    """Where a plan begins: the clock, and the temperatures of the sensors that there are."""

    begin: float  # [s]
    sensors: tuple[str, ...]
    celsius: Array  # (parts,)
    joint_size: float = 1.0  # of the joints' unit, that does what one radian does on a Delta

    @classmethod
    def after(cls, measured: LinearizedModel | None, joint_size: float = 1.0) -> Bench:
        """After what was measured; with the usual sensors where that is nothing."""
        if measured is None:
            return cls(0.0, _SENSORS, np.full(len(_SENSORS), _AMBIENT), joint_size)
        at = measured.at
        return cls(float(at.time.max()), at.temperature_parts, at.temperature[0], joint_size)

    def course(self, joint: Array) -> Conditions:
        """All that the clock and the sensors go through, at one pose (m,)."""
        return self.stops(
            np.tile(joint, (len(SLOTS), 1)),
            [StopConditions(slot=slot) for slot in range(len(SLOTS))],
        ).at

    def stops(self, joint: Array, levels: Sequence[StopConditions]) -> Samples:
        """Stops at joints (n, m) under conditions (n)."""
        course = np.array([SLOTS[level.slot] for level in levels]).reshape(-1, 2)
        at = replace(
            at_rest(joint),
            time=self.begin + course[:, 0],
            direction=np.repeat([[level.side] for level in levels], joint.shape[1], axis=1),
            travel=np.full(joint.shape, APPROACH * self.joint_size),
            payload=np.array([level.payload for level in levels]),
            payload_centre=np.zeros((len(joint), 3)),
            temperature_parts=self.sensors,
            temperature=self.celsius + course[:, 1:],
        )
        return Samples(at, np.full(len(joint), AT_REST))

    def plain(self, joint: Array) -> Samples:
        """Stops at joints (n, m) under the usual conditions."""
        return self.stops(joint, [PLAIN] * len(joint))

    def motion(self, path: MotionPath) -> Samples:
        """A path as it is driven, at even steps of time."""
        step = path.duration / (len(path.joint) - 1)
        velocity = np.gradient(path.joint, step, axis=0)
        acceleration = np.gradient(velocity, step, axis=0)
        rows = np.linspace(1, len(path.joint) - 2, _ALONG).astype(int)
        at = self.plain(path.joint[rows]).at
        at = replace(
            at,
            velocity=velocity[rows],
            acceleration=acceleration[rows],
            direction=np.where(velocity[rows] == 0, at.direction, np.sign(velocity[rows])),
            travel=np.full(at.joint.shape, np.inf),
        )
        return Samples(at, np.zeros(len(rows), dtype=np.int64))

    def levels(
        self, columns: Callable[[Samples], Array], joint: Array, payload: float
    ) -> tuple[StopConditions, ...]:
        """All combinations of what changes the columns.

        Args:
            columns: of samples under some conditions, (3 n, k).
            joint: where it is tried, (n, m) [rad].
            payload: that can be put on the platform [kg].
        """

        def under(level: StopConditions) -> Array:
            return columns(self.stops(joint, [level] * len(joint)))

        plain = columns(self.plain(joint))
        sides = (1.0, -1.0) if _differ(plain, under(StopConditions(side=-1.0))) else (1.0,)
        loads = (
            (0.0, payload) if _differ(plain, under(StopConditions(payload=payload))) else (0.0,)
        )
        slots = (
            range(len(SLOTS)) if _differ(plain, under(StopConditions(slot=_WARMEST))) else range(1)
        )
        return tuple(StopConditions(*each) for each in product(sides, loads, slots))

    def moves(self, columns: Callable[[Samples], Array], joint: Array) -> bool:
        """Whether motion changes the columns."""
        still = self.plain(joint)
        at = replace(
            still.at,
            velocity=np.full(joint.shape, _SPEED * self.joint_size),
            # not the same for all joints
            acceleration=_ACCELERATION * self.joint_size * np.cos(joint / self.joint_size),
        )
        moving = replace(still, at=at)
        return _differ(columns(still), columns(moving))


def _differ(before: Array, after: Array) -> bool:
    return bool(np.abs(after - before).max(initial=0) > _MATTERS * np.abs(before).max(initial=0))
