"""Stick-slip: static friction holds a joint back at low speed and falls at higher speed.

    dq = -a direction (c + (1 - c) h)      h = exp(-(dq/dt / v_s)^2) in motion, r at rest

Stribeck's curve as in the LuGre model ("A new model for control of systems with friction", IEEE
Trans. Automatic Control 40 (1995) 419); c is the ratio of Coulomb to static friction. The friction
twists a drive of finite stiffness.

Friction does not follow the speed at once but over some travel, the pre-sliding of that model. A
joint that stops within it keeps the twist of its motion (r = 0); one that creeps to its stop has
the whole twist of static friction (r = 1).

Friction that does not change with speed (c = 1) leaves the joint behind as backlash does, see
`Backlash.same_signal_beside`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Stage
from delta_calibration.effects.regressor import Groups, by_direction
from delta_calibration.effects.remedy import REPAIR, Remedy
from delta_calibration.effects.signals import DIRECTION, RATE
from delta_calibration.effects.usual import Usual
from delta_calibration.model.symbols import Symbol, absolute, exp, where
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class StickSlip(Effect):
    """Twist of a drive: full at low speed, a share `level` of it above `speed` [rad/s or m/s].

    At rest the share `stopped` of the part that vanishes at speed remains.
    """

    cause: ClassVar[str] = "stick_slip"
    told: ClassVar[Mapping[str, tuple[str, str]]] = {
        "speed": ("speed", "rad/s"),
        "level": ("level", "1"),
        "stopped": ("kept_at_rest", "1"),
    }
    remedy: ClassVar[Remedy] = Remedy(
        REPAIR,
        "guide or bearing",
        "clean and grease the guide or bearing, or replace it",
        "move the joint through its range at the lowest speed and watch the torque of the drive",
    )
    outside: ClassVar[str] = (
        "hold the motor still and push the arm both ways by hand: in a gap it moves freely, "
        "against a drive that yields it springs back"
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    simplest: ClassVar[tuple[str, str]] = ("direction", "line")
    needs: ClassVar[tuple[str, ...]] = ("direction",)
    limits: ClassVar[Limits] = {"speed": (1e-6, 100.0), "level": (0.0, 1.0), "stopped": (0.0, 1.0)}
    of_joints: ClassVar[tuple[str, ...]] = ("speed",)

    speed: Usual = Usual(0.1)
    level: float = 0.0
    stopped: float = 1.0  # r

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
        held = where(absolute(s[1]) > 0, exp(-((s[1] / c[0]) ** 2)), c[2])
        return -v[0] * s[0] * (c[1] + (1 - c[1]) * held)

    def constants(self, joint: int) -> tuple[float, ...]:
        """v_s, c and r."""
        del joint
        return self.speed, self.level, self.stopped

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Low to moderate speeds, each with a small, a medium and a high `level`.

        Where joints were measured at rest and in motion, each with more and with less of static
        friction left at rest; otherwise with all of it.
        """
        moved = (at.velocity != 0).any(axis=1)
        both = 0 < np.count_nonzero(moved) < len(moved)
        for speed, level, r in product(_SPEEDS, _LEVELS, _STOPPED if both else (1.0,)):
            yield replace(self, speed=speed * self.mechanism.joint_size, level=level, stopped=r)

    @property
    def rarity(self) -> float:
        """Static friction that is hardly larger than Coulomb friction is rarely found.

        Without the difference this law is that of backlash, which is then the plainer name.
        """
        return float(np.exp(max(0.0, self.level - _USUAL) ** 2 / (2 * _RARE**2)))

    def intervals(self) -> tuple[Interval, ...]:
        """Speed and level up to their neighbours in the search; `stopped` over its whole range."""
        most = min(self.level + _NEXT, max(self.level, _MOST))
        stopped = ("stopped", 0.0, _NEARLY_ALL)
        return (
            ("speed", self.speed / 2, 2 * self.speed),
            ("level", max(0.0, self.level - _NEXT), most),
            *((stopped,) if self.stopped < 1.0 else ()),
        )


_SPEEDS = 0.01, 0.03, 0.1, 0.3  # [rad/s of a Delta]
_NEXT = 0.15
_LEVELS = _NEXT, 3 * _NEXT, 5 * _NEXT
_MOST = 0.8  # static friction less than 1.25 times Coulomb's is not told from backlash
_STOPPED, _NEARLY_ALL = (0.75, 0.25), 0.99  # r = 1 is not searched
_USUAL, _RARE = 0.6, 0.07  # level up to which all are as likely, and its spread beyond
