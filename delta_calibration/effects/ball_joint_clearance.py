"""Ball joints with play: a rod is longer by the clearance when pulled, shorter when pushed.

    dl = c tanh(N / N_0)

The surface where the force N changes its sign is a step in the workspace, as wide as the force N_0
takes by which contact and friction let go of one side; 0 is a sharp one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Stage
from delta_calibration.effects.remedy import REPAIR, Remedy
from delta_calibration.effects.rods import lengthened, pairs, pulls
from delta_calibration.effects.signals import LOAD, Places
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.model.symbols import Symbol, maximum, sign, tanh, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class BallJointClearance(Effect):
    """The same clearance in every rod."""

    cause: ClassVar[str] = "ball_joint_clearance"
    told: ClassVar[Mapping[str, tuple[str, str]]] = {"force": ("force_n", "N")}
    remedy: ClassVar[Remedy] = Remedy(
        REPAIR,
        "ball joints",
        "replace the worn ball joints, or press them together",
        "pull and push a rod along its length by hand and read the gap off a dial gauge",
    )
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    limits: ClassVar[Limits] = {"force": (0.0, 1e3)}

    force: float = 0.0

    @property
    def suits(self) -> bool:
        """Whether its loads are known: those of a rotary Delta."""
        return isinstance(self.mechanism, DeltaModel)

    @property
    def parameters(self) -> ParameterSet:
        """c [m]: 5 to 50 um."""
        return self.shared("clearance", "m", 20e-6, 0.0, 1e-3)

    takes: ClassVar[tuple[str, ...]] = (LOAD,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """c tanh(N / N_0) of the rods of a pair; N_0 = 0 is a sharp step."""
        soft = maximum(c[0], 1e-12)
        a, b = (where(c[0] > 0, tanh(pull / soft), sign(pull)) for pull in pulls(s))
        return lengthened(v[0] * a, v[0] * b)

    def terms(self, places: Places) -> Iterator[Term]:
        """One for each pair of rods."""
        return pairs(self.mechanism, places, (self.force,))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A sharp step, and wider ones [N]."""
        del at
        for force in (0.0, 0.2, 0.8):
            yield replace(self, force=force)

    def intervals(self) -> tuple[Interval, ...]:
        """Between the neighbours of the search; a sharp step is one."""
        return (("force", self.force / 2, 2 * self.force),) if self.force else ()
