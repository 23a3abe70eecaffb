"""Cables that stretch under their pull.

    l = (l_0 / (1 + T_0 / EA) + k theta) (1 + T / EA)        dl = (T l - T_0 l_0) / EA

to first order in T / EA: what was let out is unstretched, and the counter was zero under T_0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array
from delta_calibration.effects.cables import CableEffect
from delta_calibration.parameters import ParameterSet
from delta_calibration.samples import Conditions


@dataclass(frozen=True)
class CableElasticity(CableEffect):
    """Elastic stretch between anchor and platform; leaves out the run from drum to anchor."""

    cause: ClassVar[str] = "cable_elasticity"
    kind: ClassVar[str] = "structure"
    needs: ClassVar[tuple[str, ...]] = ("payload",)

    @property
    def parameters(self) -> ParameterSet:
        """1/EA [1/N], one kind of cable: EA is 2e5 to 8e5 N."""
        return self.shared("compliance", "1/N", 3e-6, 0.0, 1e-3)

    def columns(self, at: Conditions) -> Array:
        """(n, m, 1) [rad N]."""
        home = self.at_home()
        stretch = self.tensions(at) * self.lengths(at)
        return self.as_angle(stretch - self.tensions(home) * self.lengths(home))[..., None]
