"""Compensation by damped Newton steps: the yardstick for the swarm.

    dq <- dq - t J^+ (point(q + dq) - p*),   t = 1, 1/2, 1/4, ... until the distance falls

with J the model's velocity Jacobian. On a smooth model that starts near, it comes to the same correction as the
swarm with a hundredth of the work. Where the model has a jump, where J is singular or where the start is
out of reach it stops and says so; it never leaves the bound.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from delta_calibration.compensation.base import (
    Array,
    Correction,
    Counts,
    Flags,
    JacobianFunction,
    PointFunction,
    checked_commands,
    distance,
    require_at_least,
    require_positive,
)


@dataclass(frozen=True)
class NewtonSettings:
    """How far and how long Newton's steps go."""

    bound_rad: float = 0.03  # largest |dq_j|
    tolerance: float = 1e-9  # [m]
    iterations: int = 15
    halvings: int = 8  # of one step, before it is given up
    condition_limit: float = 1e8  # of J; above it the pose counts as singular

    def __post_init__(self) -> None:
        """Refuse settings with which no step can be made."""
        require_positive("bound_rad", self.bound_rad, "rad")
        require_positive("tolerance", self.tolerance, "m")
        require_positive("condition_limit", self.condition_limit, "")
        require_at_least("iterations", self.iterations, 1)
        require_at_least("halvings", self.halvings, 0)


@dataclass(frozen=True)
class Newton:
    """Damped Newton as a `Compensator`; a Jacobian counts as one evaluation of the model."""

    point: PointFunction
    jacobian: JacobianFunction
    settings: NewtonSettings = field(default_factory=NewtonSettings)

    def correct(self, q: Array, target: Array) -> Correction:
        """Step to the correction of every command.

        Args:
            q: Nominal commands (n, m) [rad].
            target: Points they mean (n, 3) [m].

        Raises:
            InputError: if the shapes do not belong together.
        """
        q, target, usable = checked_commands(q, target)
        result = Correction.none(*q.shape)
        rows = np.flatnonzero(usable)
        gap = np.zeros_like(target)  # point(q + dq) - target, of the best dq so far
        gap[rows] = self.point(q[rows]) - target[rows]
        result.error[rows] = distance(gap[rows], np.zeros(3))
        result.evaluations[rows] = 1
        for _ in range(self.settings.iterations):
            rows = rows[np.isfinite(result.error[rows]) & (result.error[rows] > self.settings.tolerance)]
            if not rows.size:
                break
            step, regular = self._step(q[rows] + result.dq[rows], gap[rows])
            result.evaluations[rows] += 1
            moved = self._advance(rows[regular], step[regular], q, target, gap, result)
            rows = rows[regular][moved]
        result.converged[:] = result.error <= self.settings.tolerance
        return result

    def _step(self, q: Array, gap: Array) -> tuple[Array, Flags]:
        """Return the full step -J^+ gap (k, m) [rad], and where J allows one (k,)."""
        jacobian = self.jacobian(q)
        finite = np.isfinite(jacobian).all(axis=(1, 2))
        u, s, vt = np.linalg.svd(np.where(finite[:, None, None], jacobian, 0.0), full_matrices=False)
        regular = finite & (s[:, -1] * self.settings.condition_limit > s[:, 0])
        s = np.where(regular[:, None], s, 1.0)
        step = -np.einsum("krm,kr->km", vt, np.einsum("kcr,kc->kr", u, gap) / s)
        return step, regular

    def _advance(
        self, rows: Counts, step: Array, q: Array, target: Array, gap: Array, result: Correction
    ) -> Flags:
        """Take the longest of the halved steps that comes nearer; return for which rows one did, (k,).

        Writes the new dq and error into those rows of `result`, and the new `gap`.
        """
        bound = self.settings.bound_rad
        moved = np.zeros(len(rows), dtype=np.bool_)
        for halving in range(self.settings.halvings + 1):
            waiting = np.flatnonzero(~moved)
            if not waiting.size:
                break
            r = rows[waiting]
            dq = np.clip(result.dq[r] + 0.5**halving * step[waiting], -bound, bound)
            trial = self.point(q[r] + dq) - target[r]
            error = distance(trial, np.zeros(3))
            result.evaluations[r] += 1
            nearer = error < result.error[r]
            result.dq[r[nearer]], result.error[r[nearer]] = dq[nearer], error[nearer]
            gap[r[nearer]] = trial[nearer]
            moved[waiting] = nearer
        return moved
