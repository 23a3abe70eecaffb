"""Tree of a Delta whose pairs of rods are one: that of six rods that stand where those do."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.six_rod_delta import SixRodDeltaLook
from delta_calibration.mechanisms import Mechanism, RotaryDelta
from delta_calibration.mechanisms.six_rod_delta import alike

Array = NDArray[np.float64]


class RotaryDeltaLook(SixRodDeltaLook):
    """Arms, rods and platform of a Delta of three spheres."""

    mechanism: ClassVar[str] = RotaryDelta.name

    def model(self, mechanism: Mechanism, geometry: Array) -> tuple[Mechanism, Array]:
        """Six rods in pairs that do not differ."""
        assert isinstance(mechanism, RotaryDelta)
        return alike(mechanism, geometry)
