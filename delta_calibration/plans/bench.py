"""Conditions that a plan can vary at its stops, and which of them influence the readings.

This is computed, not listed: side of approach, payload, temperature and motion are varied if the
columns of a cause in the Jacobian change with them.
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

_SENSORS = ("arm", "base")  # temperature sensors if nothing was measured before
_AMBIENT = 20.0  # [deg C]
# Warming up for an hour, then cooling for another: time [s] and temperature rise [K].
SLOTS = ((0.0, 0.0), (1800.0, 7.0), (3600.0, 10.0), (5400.0, 4.0), (7200.0, 1.5))
_WARMEST = 2
_MATTERS = 1e-6  # a smaller relative change of the columns counts as none
_SPEED, _ACCELERATION = 0.5, 5.0  # [rad/s], [rad/s^2] of a Delta's fast motion
_ALONG = 48  # samples of a path that are evaluated


@dataclass(frozen=True)
class StopConditions:
    """Conditions of a stop that a plan can choose."""

    side: float = 1.0  # +1 or -1, side of approach
    payload: float = 0.0  # [kg]
    slot: int = 0  # index into SLOTS: time in the warm-up and cooling


PLAIN = StopConditions()


@dataclass(frozen=True)
class Bench:
    """Initial conditions of a plan: time, and temperatures of the available sensors."""

    begin: float  # [s]
    sensors: tuple[str, ...]
    celsius: Array  # (parts,) [deg C]
    joint_size: float = 1.0  # [rad or m] joint motion that corresponds to one radian of a Delta

    @classmethod
    def after(cls, measured: LinearizedModel | None, joint_size: float = 1.0) -> Bench:
        """Begin at the end of a measured session; without one, with the usual sensors."""
        if measured is None:
            return cls(0.0, _SENSORS, np.full(len(_SENSORS), _AMBIENT), joint_size)
        at = measured.at
        return cls(float(at.time.max()), at.temperature_parts, at.temperature[0], joint_size)

    def course(self, joint: Array) -> Conditions:
        """Conditions at one pose (m,) over the whole course of warm-up and cooling."""
        return self.stops(
            np.tile(joint, (len(SLOTS), 1)),
            [StopConditions(slot=slot) for slot in range(len(SLOTS))],
        ).at

    def stops(self, joint: Array, levels: Sequence[StopConditions]) -> Samples:
        """Samples of stops at joints (n, m) under n conditions."""
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
        """Samples of stops at joints (n, m) under the default conditions."""
        return self.stops(joint, [PLAIN] * len(joint))

    def motion(self, path: MotionPath) -> Samples:
        """Samples of a path in motion, at equal time steps."""
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
        """All combinations of the conditions that change the columns.

        Args:
            columns: returns the columns of a cause, (3 n, k), for samples.
            joint: joints at which the conditions are tried, (n, m) [rad or m].
            payload: mass that can be put on the platform [kg].
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
            # different for each joint
            acceleration=_ACCELERATION * self.joint_size * np.cos(joint / self.joint_size),
        )
        moving = replace(still, at=at)
        return _differ(columns(still), columns(moving))


def _differ(before: Array, after: Array) -> bool:
    return bool(np.abs(after - before).max(initial=0) > _MATTERS * np.abs(before).max(initial=0))
