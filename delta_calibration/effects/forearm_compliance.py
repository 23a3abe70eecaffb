"""Elastic stretch of the rods under their axial force, by weight and inertia.

dl = N / k
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Stage
from delta_calibration.effects.regressor import LOAD as BY_LOAD
from delta_calibration.effects.regressor import Groups, Regressor, by_payload
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.rods import lengthened, pairs, pulls
from delta_calibration.effects.signals import LOAD, Places
from delta_calibration.effects.springs import RodLoadEffect
from delta_calibration.model.symbols import Symbol
from delta_calibration.model.terms import Term
from delta_calibration.parameters import ParameterSet


@dataclass(frozen=True)
class ForearmCompliance(RodLoadEffect):
    """Elastic stretch of each rod, all of one stiffness."""

    cause: ClassVar[str] = "forearm_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "forearms",
        "compensate the elongation of the forearms, or make them stiffer",
        "repeat ten poses with a second payload: the error grows in proportion to the load",
    )
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE
    gentle: ClassVar[bool] = True

    @property
    def parameters(self) -> ParameterSet:
        """1/k of a rod [m/N]: k is 1 to 10 N/um."""
        return self.shared("rod_compliance", "m/N", 3e-7, 0.0, 1e-4)

    def regressor(self, at: Conditions) -> Regressor:
        """Payload."""
        del at
        return BY_LOAD

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups by payload."""
        del joint
        return by_payload(at)

    takes: ClassVar[tuple[str, ...]] = (LOAD,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Stretch N / k of the rods of a pair, as change of mean length and mismatch."""
        del c
        a, b = pulls(s)
        return lengthened(v[0] * a, v[0] * b)

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per pair of rods."""
        return pairs(self.mechanism, places)
