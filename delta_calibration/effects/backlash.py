"""Backlash between motor and arm, or slider: the arm rests on one flank of the gap.

    dq = -(gap / 2) sign(tau)                      where |tau| > held_by
    dq = -(gap / 2) play(direction, travel)        elsewhere

The force on the arm decides which flank it is. Friction of the arm (its bearing, its ball joints)
keeps the arm half the gap behind in the last direction of motion: after a reversal the gap is
crossed over the first `width` of travel, and the arm then stays on that flank. Where the torque
tau of weight and inertia exceeds friction, `held_by` [N m, N], it holds the arm on its own flank,
whatever the direction of approach. The flank then changes where tau changes its sign, by the pose
or the payload. On a mechanism with known masses and payload a diagnosis searches for `held_by`
among the torques of the session, or the forces of joints that slide.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import (
    NO_PAYLOAD,
    Array,
    Effect,
    Interval,
    Limits,
    Stage,
    payload_known,
)
from delta_calibration.effects.regressor import Groups, by_direction
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import (
    DIRECTION,
    GRAVITY,
    INERTIA,
    NOTHING,
    TRAVEL,
    Places,
    nominal,
)
from delta_calibration.effects.springs import STATE_MASSES, UNWEIGHED, DriveCompliance
from delta_calibration.effects.stick_slip import StickSlip
from delta_calibration.model.chain_constants import FREE_FALL, OF_WEIGHT
from delta_calibration.model.symbols import Symbol, absolute, maximum, minimum, sign, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class Backlash(Effect):
    """Lost motion of each joint."""

    cause: ClassVar[str] = "backlash"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "gear",
        "take the play out of the gear, or preload it",
        "hold the motor still, push the arm both ways by hand and read the gap off a dial gauge",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    simplest: ClassVar[tuple[str, str]] = ("direction", "line")
    needs: ClassVar[tuple[str, ...]] = ("direction",)
    live_strength: ClassVar[float] = 1.0
    limits: ClassVar[Limits] = {"held_by": (0.0, 1e4)}
    told: ClassVar[Mapping[str, tuple[str, str]]] = {"held_by": ("friction", "N m")}

    width: tuple[float, ...] = ()  # (m,) [rad] travel over which the gap is crossed
    held_by: float = 0.0  # [N m, N] load above which loads decide the flank; 0: they never do

    @property
    def parameters(self) -> ParameterSet:
        """Gap of each joint [rad]: planetary gears 1 to 5 arc minutes, RV 1, harmonic under 1."""
        return self.each_joint("gap", "rad", 0.3e-3, 0.0, 0.05)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups by the joint's last direction of motion."""
        return by_direction(at, joint)

    @property
    def takes(self) -> tuple[str, ...]:
        """Direction and travel; loads too if they can hold the arm."""
        loads = (GRAVITY, INERTIA) if self.held_by else ()
        return (DIRECTION, TRAVEL, *loads)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-(gap / 2) side, with side from -1 to 1."""
        crossed = minimum(maximum(2 * s[1] / c[0] - 1, -1.0), 1.0)
        load = s[2] + s[3]
        held = where(absolute(load) > c[1], sign(load), s[0] * crossed)
        return -v[0] * where(c[1] > 0, held, s[0] * crossed) / 2

    def constants(self, joint: int) -> tuple[float, ...]:
        """Travel over which the gap is crossed, and torque that holds the arm."""
        width = self.width[joint] if self.width else 0.0
        return (max(width, _LEAST * self.mechanism.joint_size), self.held_by)

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per joint."""
        for j in range(self.mechanism.joints):
            names = (DIRECTION, TRAVEL, GRAVITY, INERTIA)
            signals = [places.begin(name) + j for name in names]
            if not self.held_by:
                signals[2:] = 2 * [places.begin(NOTHING)]
            yield Term(tuple(signals), (j,), (j,), self.constants(j))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Loads that never decide the flank, that always do, and frictions between these."""
        yield replace(self, held_by=0.0)
        if not self._heavy:
            return
        if not replace(self, held_by=1.0).missing(at):
            torques = np.abs(self._load(at))
            torques = torques[torques > self._least_load]
            levels = np.quantile(torques, _SHARES) if torques.size else torques
            for level in np.unique([*levels[:1] / 2, *levels]):
                yield replace(self, held_by=float(level))

    def intervals(self) -> tuple[Interval, ...]:
        """Friction of the arm, from next to none to twice that of the search."""
        low, high = _LOWEST * self.held_by, 2 * self.held_by
        return (("held_by", low, high),) if self.held_by else ()

    def missing(self, at: Conditions) -> str:
        """Also an unknown payload, if loads can hold the arm."""
        if self.held_by and not payload_known(at):
            return NO_PAYLOAD
        return super().missing(at)

    @property
    def _heavy(self) -> bool:
        """Whether the robot file states the masses whose weight may hold the arm on one side."""
        return self.mechanism.heavy(self.robot.masses)

    def _load(self, at: Conditions) -> Array:
        """Load of weight on the joints of the nominal machine, (n, m) [N m, N]."""
        return nominal(self.robot, self.mechanism, at, OF_WEIGHT).of(GRAVITY)

    @property
    def _least_load(self) -> float:
        """Load [N m, N] below which its sign is only rounding error, as about upright axes."""
        return _ROUNDING * FREE_FALL * float(np.sum(self.mechanism.weights(self.robot.masses)))

    def same_signal_beside(
        self, most: Array, other: Effect, least: Array, at: Conditions
    ) -> tuple[str, str] | None:
        """Friction that winds up a drive which yields, if it hardly changes with speed.

        It leaves the arm behind from either side as friction in a gap does, unless loads decide.
        """
        if self.held_by or not other.yields:
            return None
        friction = self._too_small(most, other, least, at)
        pushed = StickSlip.outside
        return StickSlip.cause, f"{_LIKELIER}; {pushed}" if friction else pushed

    def _too_small(self, most: Array, other: Effect, least: Array, at: Conditions) -> bool:
        """Whether the gaps are less than what the friction in them would wind up the drives by.

        To keep an arm on both flanks of a gap, friction must exceed the loads of nearly all poses.
        From either side it winds up a drive of compliance c by c times as much.
        """
        if not isinstance(other, DriveCompliance) or not self._heavy:
            return False
        load = np.quantile(np.abs(self._load(at)), _NEARLY_ALL, axis=0)
        return bool((2 * load * least > most)[most > 0].all() and most.any())

    def disguised(self, at: Conditions) -> tuple[str, str, str, str] | None:
        """Backlash that a session cannot show because weight decides on which side the gap is.

        If a joint is held on one side at all poses, its backlash looks like a zero offset. If the
        payload is not known, neither is the torque, and such backlash was not searched.
        """
        if not (self.mechanism.weighed or self._heavy) or not len(at):
            return None
        if not self._heavy:
            return self._not_searched(UNWEIGHED, STATE_MASSES)
        load = self._load(at)
        side = np.where(np.abs(load) > self._least_load, np.sign(load), 0.0)
        held = np.abs(side.sum(axis=0)) == len(load)
        if not held.any():
            return (
                None
                if payload_known(at)
                else self._not_searched(NO_PAYLOAD, "record the payload: its mass and its centre")
            )
        joints = "every joint"
        if not held.all():
            names = np.array(self.robot.joints.names)[held]
            joints = f"joint{'s' if len(names) > 1 else ''} {', '.join(names)}"
        return (
            _HELD,
            "joint_zero_offset",
            f"the load of the weight on {joints} has the same sign at all poses: it closes the "
            "backlash, which is then not visible from either side of approach",
            "measure with the weight balanced or its load reversed (by a spring or counterweight)",
        )

    def _not_searched(self, lacking: str, following: str) -> tuple[str, str, str, str]:
        because = (
            f"{lacking}, and so the load is not known that may hold the backlash on one side: "
            "only backlash that follows the direction of motion was searched"
        )
        return _HELD, "none", because, following

    def wrong(self) -> str:
        """Check `held_by`, and that `width` is empty or has m numbers, none negative."""
        joints = self.mechanism.joints
        if wrong := super().wrong():
            return wrong
        if len(self.width) in (0, joints) and all(0 <= value < np.inf for value in self.width):
            return ""
        return f"width: {self.width} is not allowed; none, or {joints} of 0 or more"

    def refined(self, values: Array) -> Backlash:
        """The same effect with the gaps found as `width`: backlash is crossed over its gap."""
        return replace(self, width=tuple(np.clip(values, 0.0, None).tolist()))


_HELD = "backlash held by weight"
_LEAST = 1e-9  # [rad of a Delta]
_SHARES = np.linspace(0.0, 0.96, 25)  # of the torques of weight that are below friction
_LOWEST = 1e-6  # lower end of an interval of friction, as a share of its middle
_ROUNDING = 1e-6  # of the torque of the robot's weight at a lever of a metre
_NEARLY_ALL = 0.95  # share of the poses whose loads friction must exceed
_LIKELIER = (
    "friction is likelier: to keep the arms on both flanks of gaps under their weight it would "
    "wind up the drives by more than these gaps"
)
