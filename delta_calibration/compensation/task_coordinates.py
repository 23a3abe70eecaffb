"""Task coordinates: the tool's place as joints command it, in coordinates that can be subtracted.

    place = [p; h R e_x; h R e_y; h R e_z],   h = LEVER / sqrt(2)

with p the tool point and R the platform's orientation. The distance of two places is

    sqrt(|p - p'|^2 + (2 LEVER sin(angle / 2))^2),

angle that of the rotation between them: a small rotation counts LEVER metres per radian. Where the
joints command no rotation the place is p alone, or those of its coordinates that they command: x
and y of an arm of two joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms import Mechanism

Array = NDArray[np.float64]

LEVER = 0.3  # [m]
ARM = float(LEVER / np.sqrt(2))
_SPACE = 3


@dataclass(frozen=True)
class TaskCoordinates:
    """Coordinates of a tool at `tool` (3,) [m] that the joints of a mechanism command."""

    tool: Array
    axes: tuple[int, ...]  # of x, y, z
    turns: bool

    @classmethod
    def of(cls, mechanism: Mechanism, tool: Array) -> TaskCoordinates:
        """Return the task coordinates of a mechanism, for a tool in the platform's frame (3,) [m].

        If its joints rotate the platform the whole pose counts, even coordinates that they cannot
        choose: these follow from the others, in the nominal and the identified machine alike.
        """
        freedoms = mechanism.freedoms
        turns = max(freedoms) >= _SPACE
        return cls(tool, tuple(range(_SPACE)) if turns else freedoms, turns)

    @property
    def size(self) -> int:
        """Number of coordinates of a place."""
        return len(self.axes) + (_SPACE * _SPACE if self.turns else 0)
