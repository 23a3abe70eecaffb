"""Compensation by a particle swarm whose inertia follows its own diversity (APSO).

Pan, Qiu, Liu, *Delta parallel robot assembly error analysis and calibration* (2017), section 3, searches the
correction dq in joint space. With x_i the place of particle i, p_i the best it has seen, p_g the best any has
seen, and f the distance (9) between the model's tool point and the target:

    v_i <- w v_i + c1 r1 (p_i - x_i) + c2 r2 (p_g - x_i),   x_i <- x_i + v_i        (10)
    y_i = d . x_i, counted in m equal bins along the diagonal d                     (11), (12)
    E = -sum q_b ln q_b,  q_b = h_b / m                                             (13)
    w = 1 / (1 + 1.5 exp(-2.6 E))                                                   (14)

What the paper leaves open is fixed here. The diagonal is that of the search *box* |dq_j| <= bound, so that a
swarm that has drawn together fills few bins; bins over the swarm's own extent would never let w fall. E is
divided by ln m to lie in [0, 1], as (14) wants. Speed is bounded by a fraction of the box's width. The first
particle starts at dq = 0, so that the answer is never worse than no correction. A target leaves the search
when it is within the tolerance.

Every target sees the *same* stream of random numbers, drawn from `seed` alone: its answer then depends on the
seed, the target and the command, and neither on its row nor on its neighbours in the batch; and along a path
the corrections of neighbouring targets vary together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from delta_calibration.compensation.base import (
    Array,
    Correction,
    Counts,
    Flags,
    PointFunction,
    checked_commands,
    distance,
    require_at_least,
    require_positive,
)
from delta_calibration.errors import InputError

FEWEST_PARTICLES = 16  # with 8 a search now and then settles on a wrong place
_BLOCK = 256  # targets searched side by side: bounds memory, keeps the arrays in cache


@dataclass(frozen=True)
class ApsoSettings:
    """How the swarm searches.

    The box should be a few times the correction that is expected: the cost grows slowly with it, but the
    solution has to lie inside.
    """

    bound_rad: float = 0.03  # largest |dq_j|: half the width of the box
    particles: int = 24
    tolerance: float = 1e-7  # [m]
    iterations: int = 200  # most moves of the swarm before a target is given up
    velocity_fraction: float = 0.05  # largest |v_j| in widths of the box
    cognitive: float = 2.0  # c1, pull to the particle's own best
    social: float = 2.0  # c2, pull to the swarm's best
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse settings with which no search can be made."""
        require_positive("bound_rad", self.bound_rad, "rad")
        require_positive("tolerance", self.tolerance, "m")
        require_at_least("particles", self.particles, FEWEST_PARTICLES)
        require_at_least("iterations", self.iterations, 1)
        require_at_least("seed", self.seed, 0)
        if not 0.0 < self.velocity_fraction <= 1.0:
            raise InputError(
                f"velocity_fraction is {self.velocity_fraction}; it has to be above 0 and at most 1"
            )
        for name in ("cognitive", "social"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise InputError(f"{name} is {getattr(self, name)}; it has to be 0 or above")


@dataclass(frozen=True)
class ApsoStep:
    """The swarms of the targets still searched, after one evaluation; for plots and reports."""

    iteration: int
    rows: Counts  # (k,) the targets' rows in the call
    error: Array  # (k,) [m] distance of the best so far
    entropy: Array  # (k,) E in [0, 1]
    inertia: Array  # (k,) w


def swarm_entropy(x: Array, bound: float) -> Array:
    """Return E (n,), how evenly each swarm spreads along the diagonal of its box: (11)-(13) over ln m.

    Args:
        x: Places of the particles (joints, n, m) [rad], |x| <= bound.
        bound: Half the width of the box [rad].
    """
    joints, n, m = x.shape
    along = np.sum(x, axis=0) / (joints * bound)  # d . x as a fraction of the half diagonal
    bins = np.clip(np.floor((along + 1.0) * (0.5 * m)).astype(np.int64), 0, m - 1)
    counts = np.bincount((bins + m * np.arange(n)[:, None]).ravel(), minlength=n * m).reshape(n, m)
    return np.asarray(np.sum(_entropy_terms(m)[counts], axis=1) / np.log(m))


def inertia(entropy: Array) -> Array:
    """Return the weight w of (14): 0.4 for a swarm in one place, 0.9 for one spread evenly."""
    return np.asarray(1.0 / (1.0 + 1.5 * np.exp(-2.6 * entropy)))


def velocity(v: Array, own: Array, best: Array, w: Array, s: ApsoSettings) -> Array:
    """Return the particles' next step by (10), bounded [rad].

    Args:
        v: The last step (joints, n, m) [rad].
        own: r1 (p_i - x_i), same shape.
        best: r2 (p_g - x_i), same shape.
        w: Inertia of each swarm (n,).
        s: The settings: c1, c2 and the bound.
    """
    most = s.velocity_fraction * 2.0 * s.bound_rad
    return np.clip(w[:, None] * v + s.cognitive * own + s.social * best, -most, most)


@dataclass(frozen=True)
class Apso:
    """The swarm as a `Compensator`: needs only the model's point, no derivative, no smoothness."""

    point: PointFunction
    settings: ApsoSettings = field(default_factory=ApsoSettings)

    def correct(
        self, q: Array, target: Array, watch: Callable[[ApsoStep], None] | None = None
    ) -> Correction:
        """Search the correction of every command.

        Args:
            q: Nominal commands (n, m) [rad].
            target: Points they mean (n, 3) [m].
            watch: Called after each evaluation of the swarms, for those who want to see the search.

        Raises:
            InputError: if the shapes do not belong together.
        """
        q, target, usable = checked_commands(q, target)
        result = Correction.none(*q.shape)
        rows = np.flatnonzero(usable)
        for first in range(0, len(rows), _BLOCK):
            self._search(rows[first : first + _BLOCK], q, target, result, watch)
        return result

    def _search(
        self,
        rows: Counts,
        q: Array,
        target: Array,
        result: Correction,
        watch: Callable[[ApsoStep], None] | None,
    ) -> None:
        """Search the targets in `rows` and write what was found into those rows of `result`."""
        s = self.settings
        swarm = _Swarm(len(rows), q.shape[1], s)
        for iteration in range(s.iterations + 1):
            joints = q[rows].T[:, :, None] + swarm.x  # (joints, k, particles)
            reached = self.point(np.moveaxis(joints, 0, -1))
            swarm.judge(distance(reached, target[rows, None, :]))
            result.dq[rows], result.error[rows] = swarm.best()
            result.evaluations[rows] += s.particles
            result.converged[rows] = result.error[rows] <= s.tolerance
            entropy = swarm_entropy(swarm.x, s.bound_rad)
            w = inertia(entropy)
            if watch is not None:
                watch(ApsoStep(iteration, rows, result.error[rows], entropy, w))
            going = ~result.converged[rows]
            if iteration == s.iterations or not going.any():
                return
            rows, w = rows[going], w[going]
            swarm.keep(going)
            swarm.move(w)


class _Swarm:
    """The swarms of n targets, each array by component: (joints, n, particles)."""

    def __init__(self, n: int, joints: int, s: ApsoSettings) -> None:
        """Spread the particles over the box, the same way for every target, the first at dq = 0."""
        self._settings = s
        self._draws = np.random.Generator(np.random.Philox(s.seed))
        start = s.bound_rad * (2.0 * self._draws.random((joints, 1, s.particles)) - 1.0)
        start[..., 0] = 0.0
        self.x = np.repeat(start, n, axis=1)
        self._v = np.zeros_like(self.x)
        self._own = self.x.copy()  # p_i
        self._fitness = np.full((n, s.particles), np.inf)  # f(p_i)

    def judge(self, f: Array) -> None:
        """Let each particle remember its place if f (n, particles) [m] is its best so far.

        A place out of reach has infinite f and so is never remembered.
        """
        better = f < self._fitness
        self._fitness = np.where(better, f, self._fitness)
        self._own = np.where(better, self.x, self._own)

    def best(self) -> tuple[Array, Array]:
        """Return p_g (n, joints) [rad] and its distance (n,) [m]; p_g = 0 where nothing was in reach."""
        n = np.arange(len(self._fitness))
        winner = np.argmin(self._fitness, axis=1)  # all infinite: the first, which started at zero
        return self._own[:, n, winner].T, self._fitness[n, winner]

    def keep(self, going: Flags) -> None:
        """Drop the swarms of targets that are done."""
        if not going.all():
            self.x, self._v, self._own = self.x[:, going], self._v[:, going], self._own[:, going]
            self._fitness = self._fitness[going]

    def move(self, w: Array) -> None:
        """Move every particle by (10), with the inertia w (n,) of its swarm; the box is a wall."""
        s = self._settings
        r1, r2 = self._draws.random((2, len(self.x), 1, s.particles))
        leader = self.best()[0].T[:, :, None]
        self._v = velocity(self._v, r1 * (self._own - self.x), r2 * (leader - self.x), w, s)
        self.x = np.clip(self.x + self._v, -s.bound_rad, s.bound_rad)


def _entropy_terms(m: int) -> Array:
    """Return -q ln q for a bin that holds h = 0..m of the m particles, q = h / m; 0 for an empty one."""
    q = np.arange(m + 1) / m
    return -q * np.log(np.where(q > 0.0, q, 1.0))
