"""Compensation by a particle swarm whose inertia adapts to its diversity (APSO).

Pan, Qiu, Liu, *Delta parallel robot assembly error analysis and calibration* (2017), section 3,
search the correction dq in joint space. With x_i the position of particle i, p_i its best position
so far and p_g the best of the whole swarm, all judged by the distance (9) of the model's tool
point from the target:

    v_i <- w v_i + c1 r1 (p_i - x_i) + c2 r2 (p_g - x_i),   x_i <- x_i + v_i     (10)
    y_i = d . x_i, h_b of them in bin b of m equal bins along the diagonal d     (11), (12)
    E = -sum q_b ln q_b,  q_b = h_b / m                                          (13)
    w = 1 / (1 + 1.5 exp(-2.6 E))                                                (14)

The paper leaves some choices open; they are fixed here. The diagonal is that of the search *box*
|dq_j| <= bound, so that a contracted swarm fills few bins; with bins over the swarm's own extent w
would never fall. E is divided by ln m to lie in [0, 1], as (14) requires. Speed is bounded by a
fraction of the box's width. The first particle starts at dq = 0, so that the result is never
worse than no correction. A target leaves the search when it is within the tolerance.

Every target uses the *same* stream of random numbers, made from `seed` alone. Its result then
depends on the seed, the target and the command, not on its row or its neighbours in the batch; and
along a path the corrections of neighbouring targets vary together.

This is the readable reference, for any mechanism; `Swarm` is the same algorithm, compiled.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from delta_calibration.compensation.base import (
    Array,
    Correction,
    Flags,
    PointFunction,
    checked_commands,
    distance,
    joined,
    require_positive,
    require_whole,
)
from delta_calibration.errors import InputError
from delta_calibration.model.swarm_law import diversity, inertia

FEWEST_PARTICLES = 16  # with 8, some searches converge to a wrong position
_BLOCK = 256  # targets searched side by side: bounds memory, keeps the arrays in cache


@dataclass(frozen=True)
class ApsoSettings:
    """Settings of the swarm's search.

    The box should be a few times larger than the expected correction: the solution has to lie
    inside it, and the cost grows only slowly with its size.
    """

    bound_rad: float = 0.03  # largest |dq_j|: half the width of the box
    particles: int = 24
    tolerance: float = 1e-7  # [m]
    iterations: int = 200  # largest number of moves before a target is given up
    velocity_fraction: float = 0.05  # largest |v_j| in widths of the box
    cognitive: float = 2.0  # c1, pull to the particle's own best
    social: float = 2.0  # c2, pull to the swarm's best
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse settings with which no search can be made."""
        require_positive("bound_rad", self.bound_rad, "rad")
        require_positive("tolerance", self.tolerance, "m")
        require_positive("velocity_fraction", self.velocity_fraction)
        require_whole("particles", self.particles, FEWEST_PARTICLES)
        require_whole("iterations", self.iterations, 1)
        require_whole("seed", self.seed, 0)
        if self.velocity_fraction > 1.0:
            raise InputError(f"velocity_fraction is {self.velocity_fraction}; at most 1 allowed")
        for name, pull in (("cognitive", self.cognitive), ("social", self.social)):
            if not (np.isfinite(pull) and pull >= 0.0):
                raise InputError(f"{name} is {pull}; it has to be finite and not below 0")


def swarm_entropy(x: Array, bound: float) -> Array:
    """Return E (n,) of each swarm along the diagonal of its box: (11)-(13) divided by ln m.

    Args:
        x: Positions of the particles (joints, n, m) [rad], |x| <= bound.
        bound: Half the width of the box [rad].
    """
    return diversity(np.sum(x, axis=0) / (len(x) * bound))  # d . x in half diagonals, -1 to 1


def velocity(v: Array, own: Array, leader: Array, w: Array, s: ApsoSettings) -> Array:
    """Return the particles' next step by (10), bounded; (joints, n, m) [rad].

    Args:
        v: The last step, same shape.
        own: r1 (p_i - x_i), same shape.
        leader: r2 (p_g - x_i), same shape.
        w: Inertia of each swarm (n,).
        s: The settings: c1, c2 and the bound.
    """
    most = s.velocity_fraction * 2.0 * s.bound_rad
    return np.clip(w[:, None] * v + s.cognitive * own + s.social * leader, -most, most)


def stream(s: ApsoSettings) -> np.random.Generator:
    """Return the random numbers of a search from their beginning: Philox 4x64, counter-based."""
    return np.random.Generator(np.random.Philox(s.seed))


def first_places(draws: np.random.Generator, joints: int, s: ApsoSettings) -> Array:
    """Return start positions (joints, m) [rad]: random in the box, the first at dq = 0."""
    start = s.bound_rad * (2.0 * draws.random((joints, s.particles)) - 1.0)
    start[:, 0] = 0.0
    return np.asarray(start)


@dataclass(frozen=True)
class Apso:
    """APSO as a `Compensator`: needs only the model's point, no derivative, no smoothness."""

    point: PointFunction
    settings: ApsoSettings = field(default_factory=ApsoSettings)

    def correct(self, q: Array, target: Array) -> Correction:
        """Search the correction of every command.

        Args:
            q: Nominal commands (n, m) [rad].
            target: Tool points they are meant to reach (n, 3) [m].

        Raises:
            InputError: if the shapes do not match.
        """
        q, target, usable = checked_commands(q, target)
        rows = np.flatnonzero(usable)
        blocks = [rows[first : first + _BLOCK] for first in range(0, len(rows), _BLOCK)]
        found = [self._search(q[block], target[block]) for block in blocks]
        return joined(found, q.shape[1]).spread(usable)

    def _search(self, q: Array, target: Array) -> Correction:
        """Search finite targets side by side."""
        s = self.settings
        n, m = q.shape
        dq, error, evaluations = np.zeros((n, m)), np.full(n, np.inf), np.zeros(n, dtype=np.int64)
        swarm, live = _Swarm(n, m, s), np.arange(n)
        for iteration in range(s.iterations + 1):
            joints = np.moveaxis(q[live].T[:, :, None] + swarm.x, 0, -1)  # (k, particles, m)
            swarm.judge(distance(self.point(joints) - target[live, None, :]))
            dq[live], error[live] = swarm.best()
            evaluations[live] += s.particles
            going = error[live] > s.tolerance
            live = live[going]
            if iteration == s.iterations or not live.size:
                break
            swarm.keep(going)
            swarm.move(inertia(swarm_entropy(swarm.x, s.bound_rad)))
        return Correction(dq, error, evaluations, error <= s.tolerance)


class _Swarm:
    """The swarms of n targets, each array by component: (joints, n, particles)."""

    def __init__(self, n: int, joints: int, s: ApsoSettings) -> None:
        """Spread the particles over the box, alike for every target, the first at dq = 0."""
        self._settings = s
        self._draws = stream(s)
        self.x = np.repeat(first_places(self._draws, joints, s)[:, None], n, axis=1)
        self._v = np.zeros_like(self.x)
        self._own = self.x.copy()  # p_i
        self._fitness = np.full((n, s.particles), np.inf)  # f(p_i)

    def judge(self, f: Array) -> None:
        """Let each particle remember its position if f (n, particles) [m] is its best so far.

        A position out of reach has infinite f and so is never remembered.
        """
        better = f < self._fitness
        self._fitness = np.where(better, f, self._fitness)
        self._own = np.where(better, self.x, self._own)

    def best(self) -> tuple[Array, Array]:
        """Return p_g (n, joints) [rad] and its distance (n,) [m]; 0, inf if none was in reach."""
        n = np.arange(len(self._fitness))
        winner = np.argmin(self._fitness, axis=1)  # the first, at dq = 0, if all are infinite
        return self._own[:, n, winner].T, self._fitness[n, winner]

    def keep(self, going: Flags) -> None:
        """Drop the swarms of targets that are done."""
        if not going.all():
            self.x, self._v, self._own = (a[:, going] for a in (self.x, self._v, self._own))
            self._fitness = self._fitness[going]

    def move(self, w: Array) -> None:
        """Move every particle by (10), with its swarm's inertia w (n,); clipped to the box."""
        s = self._settings
        r1, r2 = self._draws.random((2, len(self.x), 1, s.particles))
        leader = self.best()[0].T[:, :, None]
        self._v = velocity(self._v, r1 * (self._own - self.x), r2 * (leader - self.x), w, s)
        self.x = np.clip(self.x + self._v, -s.bound_rad, s.bound_rad)
