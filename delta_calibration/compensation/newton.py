"""Compensation by damped Newton steps: the yardstick for the swarm.

    dq <- dq - t J^+ (point(q + dq) - p*),   t = 1, 1/2, 1/4, ... until the distance falls

with J the model's velocity Jacobian, and J^+ over as many directions as the joints command. On a
smooth model and near the start it comes to the same correction as the swarm for a hundredth of
the work. At a jump of the model, at a singular J or from a start out of reach it stops and says
so. It never leaves the bound.
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
    require_positive,
    require_whole,
)


@dataclass(frozen=True)
class NewtonSettings:
    """How far and how long Newton's steps go."""

    bound_rad: float = 0.03  # largest |dq_j|
    tolerance: float = 1e-9  # [m]
    iterations: int = 15
    halvings: int = 8  # of one step, before it is given up
    condition_limit: float = 1e8  # of J; at and above it the pose counts as singular
    # directions that the joints command; 0 for as many as J has. More joints than that work
    # against each other in the others, which are left alone
    freedoms: int = 0

    def __post_init__(self) -> None:
        """Refuse settings with which no step can be made."""
        require_positive("bound_rad", self.bound_rad, "rad")
        require_positive("tolerance", self.tolerance, "m")
        require_positive("condition_limit", self.condition_limit)
        require_whole("iterations", self.iterations, 1)
        require_whole("halvings", self.halvings, 0)
        require_whole("freedoms", self.freedoms, 0)

    @property
    def numbers(self) -> tuple[float, float, float, int, int]:
        """In the order that the compiled function takes them in."""
        limit, steps = float(self.condition_limit), (int(self.iterations), int(self.halvings))
        return float(self.bound_rad), float(self.tolerance), limit, *steps


@dataclass(frozen=True)
class _State:
    """Where the search of k targets stands."""

    dq: Array  # (k, m) [rad]
    gap: Array  # (k, d) [m] point(q + dq) - target
    error: Array  # (k,) [m] length of the gap
    evaluations: Counts  # (k,)

    def take(self, rows: Counts) -> _State:
        """Return the state of some targets."""
        return _State(self.dq[rows], self.gap[rows], self.error[rows], self.evaluations[rows])

    def put(self, rows: Counts, new: _State) -> _State:
        """Return the state with some targets' replaced."""
        whole = self.take(np.arange(len(self.dq)))  # a copy
        whole.dq[rows], whole.gap[rows] = new.dq, new.gap
        whole.error[rows], whole.evaluations[rows] = new.error, new.evaluations
        return whole

    def or_nearer(self, other: _State) -> _State:
        """Return, for each target, whichever state is nearer to it; the other is the later one."""
        nearer = other.error < self.error
        return _State(
            dq=np.where(nearer[:, None], other.dq, self.dq),
            gap=np.where(nearer[:, None], other.gap, self.gap),
            error=np.where(nearer, other.error, self.error),
            evaluations=other.evaluations,
        )


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
            target: Points they mean (n, d) [m].

        Raises:
            InputError: if the shapes do not belong together.
        """
        q, target, usable = checked_commands(q, target)
        if not usable.any():
            return Correction.none(*q.shape)
        return self._solve(q[usable], target[usable]).spread(usable)

    def _solve(self, q: Array, target: Array) -> Correction:
        """Step to the corrections of finite commands."""
        s = self.settings
        state = self._at(q, target, np.zeros_like(q), np.zeros(len(q), dtype=np.int64))
        live = np.flatnonzero(np.isfinite(state.error) & (state.error > s.tolerance))
        for _ in range(s.iterations):
            if not live.size:
                break
            step, regular = self._step(q[live] + state.dq[live], state.gap[live])
            state.evaluations[live] += 1
            live, before = live[regular], state.error[live[regular]]
            near = self._advance(q[live], target[live], step[regular], state.take(live))
            state = state.put(live, near)
            live = live[(near.error < before) & (near.error > s.tolerance)]
        return Correction(
            state.dq, state.error, state.evaluations, converged=state.error <= s.tolerance
        )

    def _at(self, q: Array, target: Array, dq: Array, evaluations: Counts) -> _State:
        """Return the state at the corrections dq (k, m) [rad], after one evaluation more."""
        gap = self.point(q + dq) - target
        return _State(dq, gap, distance(gap), evaluations + 1)

    def _step(self, q: Array, gap: Array) -> tuple[Array, Flags]:
        """Return the full step -J^+ gap (k, m) [rad], and where J allows one (k,)."""
        jacobian = self.jacobian(q)
        finite: Flags = np.all(np.isfinite(jacobian), axis=(1, 2))
        safe = np.where(finite[:, None, None], jacobian, 0.0)  # zero is singular, and so refused
        u, s, vt = np.linalg.svd(safe, full_matrices=False)
        few = self.settings.freedoms or s.shape[1]
        u, s, vt = u[:, :, :few], s[:, :few], vt[:, :few]
        regular: Flags = s[:, -1] * self.settings.condition_limit > s[:, 0]
        s = np.where(regular[:, None], s, 1.0)
        return -np.einsum("krm,kr->km", vt, np.einsum("kcr,kc->kr", u, gap) / s), regular

    def _advance(self, q: Array, target: Array, step: Array, start: _State) -> _State:
        """Return the state after the longest of the halved steps that comes nearer, if any."""
        bound, state, waiting = self.settings.bound_rad, start, np.arange(len(q))
        for halving in range(self.settings.halvings + 1):
            if not waiting.size:
                break
            here = state.take(waiting)
            dq = np.clip(here.dq + 0.5**halving * step[waiting], -bound, bound)
            there = self._at(q[waiting], target[waiting], dq, here.evaluations)
            nearest = here.or_nearer(there)
            state = state.put(waiting, nearest)
            waiting = waiting[nearest.error >= here.error]
        return state
