"""Elastic stretch of cables under tension.

    l = (l_0 / (1 + T_0 / EA) + k theta) (1 + T / EA)        dl = (T l - T_0 l_0) / EA

to first order in T / EA: the length let out is unstretched, and the counter was zero under T_0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.cables import CableEffect, cable, length
from delta_calibration.effects.demo import Demo
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class CableElasticity(CableEffect):
    """Elastic stretch between anchor and platform; leaves out the run from drum to anchor."""

    cause: ClassVar[str] = "cable_elasticity"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "cables",
        "compensate the elongation of the cables",
        "repeat ten poses with a second payload: the platform sinks by the amount that the "
        "stiffness of the cables predicts",
    )
    kind: ClassVar[str] = "structure"
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    demo: ClassVar[Demo | None] = Demo("identify", 24)

    @property
    def parameters(self) -> ParameterSet:
        """1/EA [1/N], one kind of cable: EA is 2e5 to 8e5 N."""
        return self.shared("compliance", "1/N", 3e-6, 0.0, 1e-3)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """(T l - T_0 l_0) / EA, as an angle."""
        own = cable(s, c)
        stretch = own.pull * length(own.at) - own.pull_home * length(own.home)
        return v[0] * stretch / own.gain
