"""Commands for a machine with more joints than freedoms: none may work against another.

Which pose more joints than freedoms come to is a compromise: on a real machine the commands of the
drawing fit no pose at all, and cables are pulled out of their set tension. So it is the pose that
is corrected, by Newton's steps in the joints, and the command is the inverse of the *identified*
machine there: all of its closure equations are met.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from delta_calibration.compensation.base import (
    Array,
    Correction,
    checked_commands,
    distance,
)
from delta_calibration.compensation.newton import Newton


@dataclass(frozen=True)
class Fitting:
    """Newton, and then the joints that fit the pose it came to, as a `Compensator`."""

    newton: Newton
    fitted: Callable[[Array], Array]  # joints (n, m) to those that fit the same pose; NaN if none

    def correct(self, q: Array, target: Array) -> Correction:
        """Find the correction of every command.

        Args:
            q: Nominal commands (n, m) [rad].
            target: Points they mean (n, d) [m].

        Raises:
            InputError: if the shapes do not belong together.
        """
        q, target, usable = checked_commands(q, target)
        if not usable.any():
            return Correction.none(*q.shape)
        q, target = q[usable], target[usable]
        found = self.newton.correct(q, target)
        joint = self.fitted(q + found.dq)
        there = np.asarray(np.isfinite(joint).all(axis=1))
        dq = np.where(there[:, None], joint - q, 0.0)
        error = np.where(there, distance(self.newton.point(q + dq) - target), np.inf)
        tolerance = self.newton.settings.tolerance
        evaluations = found.evaluations + 2
        good = np.asarray(error <= tolerance)
        return Correction(dq, error, evaluations, converged=good).spread(usable)
