"""Loss of pretension during the session: the cables stretch less and become shorter.

    dl = -e h(t) n l        e = loss T_p / EA

T_p is the pretension stated in the robot file, n the part of one newton of pretension that remains
in a cable when the pretension exerts no force on the platform (model/loads.py), l the cable's
length and h the course of the loss, 0 at the session's start. Only the elastic stretch falls: for
example with drives that hold the tension by their current and weaken as they warm up, or with a
tensioner that yields, while the counters still read the length let out. The change at home is no
error of the zeros, because these were set before.

The loss, a share of T_p, and the stiffness EA are not identifiable separately: the data determine
e alone. If `cable_elasticity` is found as well, it determines EA.

Leaves out cables that creep. If winches hold their lengths, pretension falls because the cables
lengthen as they relax. They stretch less by the same amount, and hardly anything moves.

Sizes: magnets lose 0.1 % (neodymium) or 0.2 % (ferrite) of their field per kelvin, and motors as
much of their torque, 5 to 15 % in a warm-up; EA is 2e5 to 8e5 N for steel of 4 mm, and 1e5 for
thin fibre (general knowledge). The loss cannot exceed the whole pretension. Cables lose tension
after tightening: Chinese Journal of Mechanical Engineering 32 (2019), doi
10.1186/s10033-019-0362-6.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits
from delta_calibration.effects.cables import CableEffect, cable, length
from delta_calibration.effects.regressor import CLOCK, Regressor
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import GEOMETRY, JOINT, POSE, TIGHTNESS, TIME, Places
from delta_calibration.effects.time_course import (
    TIME_CONSTANTS,
    TOLD,
    around,
    course,
    is_ramp,
    kind_of,
)
from delta_calibration.model.symbols import Symbol
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet

_LOSS, _STIFF, _SOFT = 0.2, 4e5, 1e5  # expected share lost; EA [N] of steel, and the smallest


@dataclass(frozen=True)
class PretensionLoss(CableEffect):
    """Loss of the same share of pretension in all cables, over time."""

    cause: ClassVar[str] = "pretension_loss"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "cables",
        "tighten the cables to their pretension, let the drives warm up, and calibrate again",
        "measure the tension of a cable at the reference pose before and after the session",
    )
    kind: ClassVar[str] = "structure"
    outside: ClassVar[str] = "log the tensions of the cables, or return to one reference pose"
    takes: ClassVar[tuple[str, ...]] = (JOINT, TIGHTNESS, TIME, POSE, GEOMETRY)
    told: ClassVar[Mapping[str, tuple[str, str]]] = TOLD
    limits: ClassVar[Limits] = {"time_constant": (0.0, 1e9)}

    time_constant: float = 0.0  # [s]; 0: ramp, with e per hour

    @property
    def suits(self) -> bool:
        """Whether there are more cables than freedoms, and a pretension."""
        return (
            super().suits
            and self.mechanism.joints > self.mechanism.pose_size
            and self.cables.pretension > 0
        )

    @property
    def unsuited(self) -> str:
        """Reason: no cables, no more cables than freedoms, or no pretension."""
        if not super().suits:
            return super().unsuited
        if self.cables.pretension > 0:
            return (
                f"it has no more cables ({self.mechanism.joints}) than degrees of freedom, so "
                "weight alone determines their tension"
            )
        return "geometry.pretension_n is 0; more than 0 is needed"

    @property
    def parameters(self) -> ParameterSet:
        """Strain e that the lost pretension caused [1]."""
        pull = self.cables.pretension
        return self.shared("strain", "1", _LOSS * pull / _STIFF, 0.0, pull / _SOFT)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-e h(t) n l, as the motor angle that lets out as much."""
        last = c.shape[0] - 1
        own = cable(s, c[0:last])
        tightness, time = s[1], s[2]
        return (
            -v[0] * course(time, c[last], -1.0, 0.0, 0.0) * tightness * length(own.at) / own.gain
        )

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per cable, with tightness and time in place of its pulls."""
        for i, term in enumerate(super().terms(places)):
            own = places.begin(JOINT) + i, places.begin(TIGHTNESS) + i, places.begin(TIME)
            signals = (*own, *term.signals[len(own) :])
            yield replace(term, signals=signals, constants=(*term.constants, self.time_constant))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A ramp, and settling from minutes to over an hour."""
        del at
        for constant in (0.0, *TIME_CONSTANTS):
            yield replace(self, time_constant=constant)

    @property
    def per_hour(self) -> bool:
        """Whether the loss is a ramp."""
        return is_ramp(self.time_constant)

    @property
    def follows(self) -> str:
        """A ramp or settling."""
        return kind_of(self.time_constant)

    def intervals(self) -> tuple[Interval, ...]:
        """Interval of the time constant; none for a ramp."""
        return around(self.time_constant)

    def regressor(self, at: Conditions) -> Regressor:
        """Time."""
        del at
        return CLOCK

    @property
    def bound_to_session(self) -> bool:
        """True: a loss by the clock goes by the clock of its session."""
        return True
