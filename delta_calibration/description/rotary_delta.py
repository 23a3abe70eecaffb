"""Tree of a rotary Delta with one forearm per leg: drawn as the equivalent six-rod Delta."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.six_rod_delta import SixRodDeltaLook
from delta_calibration.mechanisms import Mechanism, RotaryDelta
from delta_calibration.mechanisms.six_rod_delta import alike

Array = NDArray[np.float64]


class RotaryDeltaLook(SixRodDeltaLook):
    """Arms, rods and platform of a rotary Delta with one forearm per leg."""

    mechanism: ClassVar[str] = RotaryDelta.name

    def model(self, mechanism: Mechanism, geometry: Array) -> tuple[Mechanism, Array]:
        """The equivalent six-rod Delta, with two equal rods per leg."""
        assert isinstance(mechanism, RotaryDelta)
        return alike(mechanism, geometry)
