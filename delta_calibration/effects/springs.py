"""Bases of the effects of parts that deform under load.

dq = -tau / k        tau = dU/dq + J^T M a

for a drive, with the torque of the weight that it holds and of the inertia that it accelerates;
tau is a force where the drive slides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.signals import GRAVITY, INERTIA
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet

GIVE, MOST_GIVE = 4e-5, 1e-2  # [rad/(N m)] compliance 1/k of a drive: expected, and largest
UNWEIGHED = "the robot file states no masses"
STATE_MASSES = "state the masses in the robot file (mass_kg of each link, if it is an arm)"


@dataclass(frozen=True)
class WeightEffect(Effect):
    """Base of the effects of loads that follow from the masses of moving parts."""

    @property
    def lacking(self) -> str:
        """Masses that the robot file does not state (`mass_kg` of an arm's links)."""
        return "" if self.mechanism.heavy(self.robot.masses) else UNWEIGHED

    def missing(self, at: Conditions) -> str:
        """Also what the robot file lacks."""
        return self.lacking or super().missing(at)

    def remedied(self, lacking: str) -> str:
        """What to do: state the masses, if the robot file has none."""
        if lacking == UNWEIGHED:
            return STATE_MASSES
        return super().remedied(lacking)


@dataclass(frozen=True)
class LoadEffect(WeightEffect):
    """Base of the effects of the loads of drives that push as well as pull."""

    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether the loads of the drives follow from masses in the robot file."""
        return self.mechanism.weighed

    @property
    def unsuited(self) -> str:
        """Reason: cables, or a mechanism whose robot file has no masses."""
        if self.mechanism.pulls:
            return super().unsuited
        return f"the robot file of a {self.mechanism.name} has no masses, from which loads follow"


@dataclass(frozen=True)
class RodLoadEffect(Effect):
    """Base of the effects of the forces in the rods of a rotary Delta."""

    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def suits(self) -> bool:
        """Whether the mechanism is a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)


@dataclass(frozen=True)
class DriveCompliance(Effect):
    """Base of the elastic twist of each drive behind its encoder."""

    stage: ClassVar[Stage] = Stage.DRIVE
    gentle: ClassVar[bool] = True
    yields: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    takes: ClassVar[tuple[str, ...]] = (GRAVITY, INERTIA)

    @property
    def parameters(self) -> ParameterSet:
        """1/k of each joint [rad/(N m), m/N]: rotary drives have 1e4 to 1e5 N m/rad."""
        return self.each_joint("compliance", "rad/(N m)", GIVE, 0.0, MOST_GIVE)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-tau / k, with tau of weight and inertia."""
        del c
        return -v[0] * (s[0] + s[1])
