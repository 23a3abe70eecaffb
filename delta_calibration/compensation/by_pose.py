"""Commands by way of the pose, where all of the pose is commanded: Newton, then the inverse.

    x <- x - (dplace/dx)^+ (place(x) - p*),    q = inverse(x) of the identified machine

The first asks nothing of the machine but where its tool is fixed, the second is closed or nearly
so for most: no direct problem is solved on the way. It is also the only way where there are more
joints than freedoms. Which pose those come to is a compromise: on a real machine the commands of
the drawing fit no pose at all, and cables are pulled out of their set tension. The inverse of the
identified machine meets all of its closure equations, and no joint works against another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delta_calibration.compensation.aim import Aim
from delta_calibration.compensation.base import (
    Array,
    Correction,
    checked_commands,
    distance,
)
from delta_calibration.mechanisms import Mechanism
from delta_calibration.mechanisms.base import solve

_STEPS = 20
_SETTLED = 1e-12  # [m, rad] last step


@dataclass(frozen=True)
class ByPose:
    """Joints of the corrected pose, as a `Compensator`, where all of the pose is aimed at.

    The error is that of the pose; whether the joints come to it is for the whole chain to say.
    """

    mechanism: Mechanism
    geometry: Array  # (p,)
    aim: Aim
    tolerance: float = 1e-9  # [m]

    def correct(self, q: Array, target: Array) -> Correction:
        """Find the correction of every command.

        Args:
            q: Nominal commands (n, m) [rad].
            target: Points they mean (n, d) [m].

        Raises:
            InputError: if the shapes do not belong together.
        """
        q, target, usable = checked_commands(q, target, self.aim.size)
        if not usable.any():
            return Correction.none(*q.shape)
        q, target = q[usable], target[usable]
        x = self._pose(q, target)
        joint = self.mechanism.inverse(x, self.geometry, q)
        there = np.asarray(np.isfinite(joint).all(axis=1))
        error = distance(self.aim.places(self.mechanism, x) - target)
        error = np.where(there, error, np.inf)
        dq, good = np.where(there[:, None], joint - q, 0.0), np.asarray(error <= self.tolerance)
        once = np.ones(len(q), dtype=np.int64)
        return Correction(dq, error, once, converged=good).spread(usable)

    def _pose(self, q: Array, target: Array) -> Array:
        """Poses (n, k) with the tool at the targets."""
        x = self.mechanism.start(q, self.geometry)
        for _ in range(_STEPS):
            gap = self.aim.places(self.mechanism, x) - target
            step = solve(self.aim.slopes(self.mechanism, x), gap[..., None])[..., 0]
            x = x - step
            if not (np.abs(step) > _SETTLED).any():  # nothing, or nothing known, moves
                break
        return x
