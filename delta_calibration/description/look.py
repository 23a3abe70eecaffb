"""Base class of looks; a look says how the machines of one mechanism are drawn.

Each look has a file of its own and is found by the mechanism's name. A package that adds a
mechanism adds its look in the entry-point group `delta_calibration.looks`: the name of the entry
is the mechanism's name, its value is `module:Class`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.parts import Parts
from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import Robot

Array = NDArray[np.float64]


class Look(ABC):
    """Links, joints and struts of the tree that shows a mechanism."""

    mechanism: ClassVar[str]  # name of the mechanism

    def model(self, mechanism: Mechanism, geometry: Array) -> tuple[Mechanism, Array]:
        """Mechanism and geometry (p,) to be drawn instead of these; unchanged by default."""
        return mechanism, geometry

    @abstractmethod
    def parts(self, robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
        """Links, joints and struts of the mechanism with a geometry (p,)."""
