"""How machines of one mechanism are drawn; a file for each mechanism, found by its name.

A package that adds a mechanism adds its look in the entry-point group `delta_calibration.looks`:
the entry's name is the mechanism's, its value `module:Class`.
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
        """Mechanism and geometry (p,) that are drawn in place of these; the same by default."""
        return mechanism, geometry

    @abstractmethod
    def parts(self, robot: Robot, mechanism: Mechanism, geometry: Array) -> Parts:
        """The mechanism's own part of the tree, for a geometry (p,)."""
