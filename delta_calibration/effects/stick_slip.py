"""Friction that holds a joint back while it creeps and lets go at speed.

    dq = -a direction (c + (1 - c) exp(-(dq/dt / v_s)^2))

Stribeck's curve as in the LuGre model ("A new model for control of systems with friction", IEEE
Trans. Automatic Control 40 (1995) 419); c is Coulomb's level over that of static friction. A drive
of finite stiffness is twisted by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Interval, Limits, Stage, diagonal
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class StickSlip(Effect):
    """Twist of a drive: full at creeping speed, `level` of it beyond `speed` [rad/s]."""

    cause: ClassVar[str] = "stick_slip"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    needs: ClassVar[tuple[str, ...]] = ("direction",)
    limits: ClassVar[Limits] = {"speed": (1e-6, 100.0), "level": (0.0, 1.0)}

    speed: float = 0.1
    level: float = 0.0

    @property
    def parameters(self) -> ParameterSet:
        """a of each joint [rad]."""
        return self.each_joint("stick", "rad", 50e-6, 0.0, 0.01)

    def columns(self, at: Conditions) -> Array:
        """(n, m, m)."""
        let_go = np.exp(-((at.velocity / self.speed) ** 2))
        return diagonal(-at.direction * (self.level + (1 - self.level) * let_go))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Speeds from creeping to brisk, with little left beyond them and with some."""
        del at
        for speed, level in product((0.01, 0.03, 0.1, 0.3), (_LEVEL, 3 * _LEVEL)):
            yield replace(self, speed=speed, level=level)

    def intervals(self) -> tuple[Interval, ...]:
        """Between the neighbours of the search."""
        return (
            ("speed", self.speed / 2, 2 * self.speed),
            ("level", max(0.0, self.level - _LEVEL), min(self.level + _LEVEL, 1.0)),
        )


_LEVEL = 0.15
