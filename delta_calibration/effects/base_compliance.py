"""A base on compliant feet: it sinks and tilts under the forces of the machine.

d = (F_x + k b_y, F_y - k b_x, F_z) / K with k = K h
b = (2 (M_x - h F_y), 2 (M_y + h F_x), M_z) / (K r^2)

F and M are force and moment on the base about its origin, by weight and inertia of all moving
parts (model/loads.py); d shifts the base and b turns it. Three or more equal feet stand evenly on
a circle of radius r, h below the origin. Together they have the stiffness K, the same sideways and
upright. A constant displacement of the base is absorbed by the tracker's frame: only changes with
pose, payload and motion are identifiable. Valid for motions that are slow compared with the
natural vibration of the base on its feet.

Feet stand below all moving parts, which distinguishes them from compliant drives and rods: a
tilting base moves a load outwards, compliance above it lets the load sink inwards. A base that
hangs from mounts above its platform moves the load as rods and drives do; the effect cannot
distinguish it from them.

Source: stiffness matrix of a body on equal springs, e.g. E. Rivin, Passive Vibration Isolation,
ASME Press 2003.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array, Effect, Interval, Limits, Stage
from delta_calibration.effects.regressor import Groups, Regressor, by_payload
from delta_calibration.effects.remedy import REPAIR, Remedy
from delta_calibration.effects.signals import REACTION
from delta_calibration.effects.springs import WeightEffect
from delta_calibration.mechanisms import SerialArm
from delta_calibration.model.symbols import Symbol, column
from delta_calibration.parameters import ParameterSet

# 110 kg of machine and frame on feet of this compliance vibrate at 30 Hz, the least that a maker
# requires of an arm's foundation (ABB, IRB 4400 product manual 3HAC022032-001, loads on
# foundation).
_GIVE = 2.5e-7  # [m/N]
_SOFTEST = 2e-5  # [m/N] 50 kg at 5 Hz: typical of vibration isolators (Rivin 2003)
# [m] from base or platform down to the feet: on a plate beneath, on a table, on the floor
_BELOW = (0.15, 0.5, 1.5)
_RADII = (0.25, 0.5, 1.0)  # [m] of a pedestal, a table, a portal around the workspace


@dataclass(frozen=True)
class BaseCompliance(WeightEffect):
    """Elastic compliance of the feet that the base, or its frame, stands on."""

    cause: ClassVar[str] = "base_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        REPAIR,
        "feet of the base",
        "tighten, level or stiffen the feet or floor under the base, and calibrate again",
        "hold a dial gauge from the floor to the base and drive the platform from side to side",
    )
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.BASE
    gentle: ClassVar[bool] = True
    valley: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    called: ClassVar[str] = "base on soft feet"
    takes: ClassVar[tuple[str, ...]] = (REACTION,)
    limits: ClassVar[Limits] = {"depth": (0.0, 5.0), "radius": (0.05, 5.0)}
    told: ClassVar[Mapping[str, tuple[str, str]]] = {
        "depth": ("depth_m", "m"),
        "radius": ("radius_m", "m"),
    }

    depth: float = 1.2  # [m] of the feet below the base's origin
    radius: float = 0.5  # [m] of the circle that they stand on

    @property
    def suits(self) -> bool:
        """Whether the robot file can state its masses, and it has a single base, not posts."""
        return self.mechanism.weighed or isinstance(self.mechanism, SerialArm)

    @property
    def parameters(self) -> ParameterSet:
        """Compliance 1 / K of all feet together [m/N]: how far the base sinks per newton."""
        return self.shared("give", "m/N", _GIVE, 0.0, _SOFTEST)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Shift (3) [m] and turn (3) [rad] of the base."""
        force, moment, h, turning = s[0:3], s[3:6], c[0], v[0] / (c[1] * c[1])
        about_x = 2 * turning * (moment[0] - h * force[1])
        about_y = 2 * turning * (moment[1] + h * force[0])
        return column(
            v[0] * force[0] + h * about_y,
            v[0] * force[1] - h * about_x,
            v[0] * force[2],
            about_x,
            about_y,
            turning * moment[2],
        )

    def constants(self, joint: int) -> tuple[float, ...]:
        """Depth and radius of the feet."""
        del joint
        return self.depth, self.radius

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Feet at several depths below all moving parts, on circles of several radii."""
        del at
        deepest = self.limits["depth"][1]
        for below, radius in product(_BELOW, _RADII):
            yield replace(self, depth=min(self._reach + below, deepest), radius=radius)

    def intervals(self) -> tuple[Interval, ...]:
        """Depth and radius between their neighbours in the search, below all moving parts."""
        reach, r = self._reach, self.radius
        below = max(self.depth - reach, _BELOW[0])
        return ("depth", reach + below / 2, reach + 2 * below), ("radius", r / 2, 2 * r)

    @property
    def _reach(self) -> float:
        """Depth of the platform at home below the base's origin, at least 0 [m]."""
        model = self.mechanism
        x = model.forward(model.home[None], model.parameters.nominal)
        return float(max(0.0, -model.position(x)[0, 2]))

    def regressor(self, at: Conditions) -> Regressor:
        """Moment of the nominal machine that tilts the base."""
        del at
        return Regressor("moment that tilts the base [N m]", self._moment)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups by payload."""
        del joint
        return by_payload(at)

    def _moment(self, at: Conditions, joint: int) -> Array:
        """Moment about x (joint 0), about y (joint 1), or its magnitude (others), (n,) [N m]."""
        moment = self.nominal(at).of(REACTION)[:, 3:5]
        if joint < 2:
            return np.asarray(moment[:, joint])
        return np.asarray(np.hypot(*moment.T))
