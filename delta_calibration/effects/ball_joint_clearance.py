"""Ball joints with clearance: a rod is longer by it when pulled, shorter when pushed.

    dl = c tanh(N / N_0)        N = N_m + e (w / 2) n

N is the force along the rod at the ball joint with clearance. It is the force N_m in the rod's
middle plus half of the rod's weight w along the rod (n is 1 for an upright rod, 0 for a level one)
at the elbow, e = 1, from which the rod hangs, and minus as much at the platform, e = -1. For
clearance at both ends, or at an unknown end, e = 0. Where N changes its sign, the error makes a
step in the workspace. N_0 is the force over which contact and friction release one side and sets
the step's width; 0 makes it sharp.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Stage
from delta_calibration.effects.remedy import REPAIR, Remedy
from delta_calibration.effects.rods import lengthened, pairs, pulls
from delta_calibration.effects.signals import JOINT, LOAD, POSE, Places
from delta_calibration.effects.springs import RodLoadEffect
from delta_calibration.mechanisms.delta_leg import DeltaModel
from delta_calibration.model.chain_constants import FREE_FALL
from delta_calibration.model.symbols import Symbol, maximum, sign, sin, tanh, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class BallJointClearance(RodLoadEffect):
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

    limits: ClassVar[Limits] = {"force": (0.0, 1e3), "end": (-1.0, 1.0)}

    force: float = 0.0
    end: float = 0.0  # end of the rods with clearance: -1 platform, 1 elbow, 0 both or unknown

    @property
    def parameters(self) -> ParameterSet:
        """c [m]: 5 to 50 um."""
        return self.shared("clearance", "m", 20e-6, 0.0, 1e-3)

    takes: ClassVar[tuple[str, ...]] = (LOAD, JOINT, POSE)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """c tanh(N / N_0) of the rods of a pair; N_0 = 0 is a sharp step."""
        upright = -(s[3] + c[2] * sin(c[4] * (s[2] - c[5]))) / c[3]
        soft = maximum(c[0], 1e-12)
        a, b = (
            where(c[0] > 0, tanh(pull / soft), sign(pull))
            for pull in (pull + c[1] * upright for pull in pulls(s))
        )
        return lengthened(v[0] * a, v[0] * b)

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per pair of rods: its loads, its joint, the platform's height."""
        model = self.mechanism
        assert isinstance(model, DeltaModel)
        drawn, drives, masses = model.dimensions, model.drives, self.robot.masses
        half = 0.0 if masses is None else self.end * masses.rod * FREE_FALL / 2
        height = places.begin(POSE) + 2
        for leg, pair in enumerate(pairs(model, places)):
            signals = (*pair.signals, places.begin(JOINT) + leg, height)
            reads = (drives.sense[leg], drives.zero[leg])
            constants = (self.force, half, drawn.arm, drawn.rod, *reads)
            yield replace(pair, signals=signals, constants=constants)

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A sharp step and wider ones [N], with the end of the rods left open (`end` 0)."""
        del at
        for force in _FORCES:
            yield replace(self, force=force, end=0.0)

    def refinements(self, at: Conditions) -> Iterator[Effect]:
        """Each step of the search, with clearance at both ends of the rods or at one only."""
        del at
        for force, end in product(_FORCES, (0.0, -1.0, 1.0)):
            yield replace(self, force=force, end=end)

    @property
    def chosen(self) -> dict[str, str]:
        """End of the rods with clearance, if it was found."""
        return {"worn_end": "elbow" if self.end > 0 else "platform"} if self.end else {}

    def intervals(self) -> tuple[Interval, ...]:
        """Interval of the force between neighbours in the search; none for a sharp step."""
        return (("force", self.force / 2, 2 * self.force),) if self.force else ()


_FORCES = (0.0, 0.2, 0.8)  # [N]
