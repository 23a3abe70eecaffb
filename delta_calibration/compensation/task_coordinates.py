"""What of the tool a joint command aims at, in coordinates that can be subtracted.

    place = [p; h R e_x; h R e_y; h R e_z],   h = LEVER / sqrt(2)

with p the tool point and R the platform's orientation. The distance of two places is

    sqrt(|p - p'|^2 + (2 LEVER sin(angle / 2))^2),

angle that of the turn between them: a turn of a radian counts as LEVER metres. Where the joints
command no turn the place is p alone, or those of its coordinates that they command: x and y of an
arm of two joints.
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
    """Which coordinates of the tool a mechanism's joints command, the tool at `tool` (3,) [m]."""

    tool: Array
    axes: tuple[int, ...]  # of x, y, z
    turns: bool

    @classmethod
    def of(cls, mechanism: Mechanism, tool: Array) -> TaskCoordinates:
        """What this mechanism's joints command of a tool in the platform's frame (3,) [m].

        Where they turn the platform the whole pose counts, also what is no choice of theirs: it
        follows from the rest, for the nominal machine and the identified one alike.
        """
        freedoms = mechanism.freedoms
        turns = max(freedoms) >= _SPACE
        return cls(tool, tuple(range(_SPACE)) if turns else freedoms, turns)

    @property
    def size(self) -> int:
        """Coordinates of a place."""
        return len(self.axes) + (_SPACE * _SPACE if self.turns else 0)
