"""Stick-slip: static friction holds a joint back at low speed and falls at higher speed.

    dq = -a direction (c + (1 - c) exp(-(dq/dt / v_s)^2))

Stribeck's curve as in the LuGre model ("A new model for control of systems with friction", IEEE
Trans. Automatic Control 40 (1995) 419); c is the ratio of Coulomb to static friction. The friction
twists a drive of finite stiffness.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Stage
from delta_calibration.effects.regressor import Groups, by_direction
from delta_calibration.effects.remedy import REPAIR, Remedy
from delta_calibration.effects.signals import DIRECTION, RATE
from delta_calibration.effects.usual import Usual
from delta_calibration.model.symbols import Symbol, exp
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class StickSlip(Effect):
    """Twist of a drive: full at low speed, a share `level` of it above `speed` [rad/s or m/s]."""

    cause: ClassVar[str] = "stick_slip"
    told: ClassVar[Mapping[str, tuple[str, str]]] = {
        "speed": ("speed", "rad/s"),
        "level": ("level", "1"),
    }
    remedy: ClassVar[Remedy] = Remedy(
        REPAIR,
        "guide or bearing",
        "clean and grease the guide or bearing, or replace it",
        "move the joint through its range at the lowest speed and watch the torque of the drive",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    needs: ClassVar[tuple[str, ...]] = ("direction",)
    limits: ClassVar[Limits] = {"speed": (1e-6, 100.0), "level": (0.0, 1.0)}
    of_joints: ClassVar[tuple[str, ...]] = ("speed",)

    speed: Usual = Usual(0.1)
    level: float = 0.0

    @property
    def parameters(self) -> ParameterSet:
        """a of each joint [rad]."""
        return self.each_joint("stick", "rad", 50e-6, 0.0, 0.01)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups by the joint's last direction of motion."""
        return by_direction(at, joint)

    takes: ClassVar[tuple[str, ...]] = (
        DIRECTION,
        RATE,
    )

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Twist by Stribeck's curve."""
        let_go = exp(-((s[1] / c[0]) ** 2))
        return -v[0] * s[0] * (c[1] + (1 - c[1]) * let_go)

    def constants(self, joint: int) -> tuple[float, ...]:
        """v_s and c."""
        del joint
        return self.speed, self.level

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Low to moderate speeds, each with a small and a larger `level`."""
        del at
        for speed, level in product(_SPEEDS, (_LEVEL, 3 * _LEVEL)):
            yield replace(self, speed=speed * self.mechanism.joint_size, level=level)

    def intervals(self) -> tuple[Interval, ...]:
        """Searched fields, each between its neighbours in the search."""
        return (
            ("speed", self.speed / 2, 2 * self.speed),
            ("level", max(0.0, self.level - _LEVEL), min(self.level + _LEVEL, 1.0)),
        )


_SPEEDS = 0.01, 0.03, 0.1, 0.3  # [rad/s of a Delta]
_LEVEL = 0.15
