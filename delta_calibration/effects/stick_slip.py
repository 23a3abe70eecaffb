"""Friction that holds a joint back while it creeps and lets go at speed.

dq = -a direction exp(-|dq/dt| / v_s)        Stribeck
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Limits, Stage, diagonal
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class StickSlip(Effect):
    """Error of presliding: full at creeping speed, gone beyond `speed` [rad/s]."""

    cause: ClassVar[str] = "stick_slip"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    needs: ClassVar[tuple[str, ...]] = ("direction",)
    limits: ClassVar[Limits] = {"speed": (1e-6, 100.0)}

    speed: float = 0.1

    @property
    def parameters(self) -> ParameterSet:
        """a of each joint [rad]."""
        return self.each_joint("stick", "rad", 50e-6, 0.0, 0.01)

    def columns(self, at: Conditions) -> Array:
        """(n, m, m)."""
        return diagonal(-at.direction * np.exp(-np.abs(at.velocity) / self.speed))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Speeds from creeping to brisk."""
        del at
        for speed in (0.01, 0.03, 0.1, 0.3):
            yield replace(self, speed=speed)

    def interval(self) -> tuple[str, float, float] | None:
        """Between the neighbours of the search."""
        return "speed", self.speed / 2, 2 * self.speed
