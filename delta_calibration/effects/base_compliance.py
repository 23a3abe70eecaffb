"""A base on soft mounts: it moves and tilts by what the machine presses on it.

d = (C_s F_x + e M_y, C_s F_y - e M_x, C_u F_z)    b = (C_t M_x - e F_y, C_t M_y + e F_x, C_z M_z)

F and M are force and moment on the base about its origin, by weight and inertia of all that moves
(model/loads.py); d shifts the base and b turns it. Mounts give alike to all sides; e is their
coupling, C_t times how far from the origin they are in height. What is constant is a place of the
base like any other, and the tracker's frame has it: only what changes with pose, payload and
motion shows. Valid where motions are slow against the swinging of the base on its mounts.

Source: stiffness matrix of a body on springs that is symmetric about its upright axis, e.g.
E. Rivin, Passive Vibration Isolation, ASME Press 2003.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.regressor import Groups, Regressor, by_payload
from delta_calibration.effects.remedy import REPAIR, Remedy
from delta_calibration.effects.signals import REACTION
from delta_calibration.mechanisms import SerialArm
from delta_calibration.model.symbols import Symbol, column
from delta_calibration.parameters import Parameter, ParameterSet

# Of a machine of some kilograms that move, on a frame that gives by 4 N/um and by 0.25 N m/urad:
# four feet of 1 N/um each, 0.25 m off the middle. Softer than feet can be is a machine of 50 kg
# that swings at under 5 Hz, 1 / (50 kg (2 pi 5 Hz)^2): that is an isolator's figure (Rivin 2003).
_SHIFT, _TURN = 2.5e-7, 4e-6  # [m/N], [rad/(N m)]
_COUPLING = 5e-7  # [rad/N] of mounts 0.12 m off the base's origin
_SOFTEST = 80.0  # times as soft
_UNWEIGHED = "the robot file states no masses"


@dataclass(frozen=True)
class BaseCompliance(Effect):
    """Elastic give of what the base stands on, or hangs from, alike to all sides."""

    cause: ClassVar[str] = "base_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        REPAIR,
        "mounts of the base",
        "tighten, level or stiffen what the base stands on, and calibrate again",
        "hold a dial gauge from the floor to the base and drive the platform from side to side",
    )
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.BASE
    gentle: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    called: ClassVar[str] = "base on soft mounts"
    takes: ClassVar[tuple[str, ...]] = (REACTION,)

    @property
    def suits(self) -> bool:
        """Whether its file can say what it weighs, and it has one base: cables have posts."""
        weighed = self.mechanism.Masses is not None or isinstance(self.mechanism, SerialArm)
        return weighed and not self.mechanism.pulls

    @property
    def parameters(self) -> ParameterSet:
        """C_s, C_u [m/N], C_t, C_z [rad/(N m)], e [rad/N]."""
        of = (
            ("give_sideways", "m/N", _SHIFT, 0.0),
            ("give_upright", "m/N", _SHIFT, 0.0),
            ("tilt", "rad/(N m)", _TURN, 0.0),
            ("turn", "rad/(N m)", _TURN, 0.0),
            ("coupling", "rad/N", _COUPLING, -1.0),
        )
        return ParameterSet(
            tuple(
                Parameter(
                    name,
                    unit,
                    0.0,
                    size,
                    self.cause,
                    None,
                    least * _SOFTEST * size,
                    _SOFTEST * size,
                )
                for name, unit, size, least in of
            )
        )

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Shift (3) [m] and turn (3) [rad] of the base."""
        del c
        force, moment, e = s[0:3], s[3:6], v[4]
        return column(
            v[0] * force[0] + e * moment[1],
            v[0] * force[1] - e * moment[0],
            v[1] * force[2],
            v[2] * moment[0] - e * force[1],
            v[2] * moment[1] + e * force[0],
            v[3] * moment[2],
        )

    def missing(self, at: Conditions) -> str:
        """Also where nobody has stated what the links of an arm weigh (`mass_kg`)."""
        if not self.mechanism.weights(self.robot.masses).any():
            return _UNWEIGHED
        return super().missing(at)

    def remedied(self, lacking: str) -> str:
        """State the masses, where these are what is missing."""
        if lacking == _UNWEIGHED:
            return "state mass_kg of the links in the robot file"
        return super().remedied(lacking)

    def regressor(self, at: Conditions) -> Regressor:
        """Moment that tilts the base, of the nominal machine."""
        del at
        return Regressor("moment that tilts the base [N m]", self._moment)

    def groups(self, at: Conditions, joint: int) -> Groups:
        """By payload."""
        del joint
        return by_payload(at)

    def _moment(self, at: Conditions, joint: int) -> Array:
        """About x, about y or the length of both, by the joint's number, (n,) [N m]."""
        moment = self.nominal(at).of(REACTION)[:, 3:5]
        if joint < 2:
            return np.asarray(moment[:, joint])
        return np.asarray(np.hypot(*moment.T))
