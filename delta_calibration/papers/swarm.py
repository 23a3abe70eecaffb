"""Particle swarms that look for the parameters with the least residual: QPSO, PSO, APSO.

A swarm asks for the residual's norm only, no derivative; all its particles are evaluated at once.
Laws by which particles move, in coordinates in which the search box is |x_j| <= 1, with p_i the
best place that particle i has seen, g the best that any has, r, phi, u uniform in [0, 1]:

    QPSO   x_i = phi p_i + (1 - phi) g +- a |c - x_i| ln(1/u),  c the mean of all p_i
    PSO    v_i = w v_i + c1 r1 (p_i - x_i) + c2 r2 (g - x_i),   x_i = x_i + v_i
    APSO   the same, w from the swarm's own diversity

QPSO is paper 004 (11)-(13), the contraction a falling evenly from 1 to 0.5; PSO has w falling
evenly in the same way; APSO is paper 000 (10)-(14).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError, InputError
from delta_calibration.model.swarm_law import diversity, inertia

Array = NDArray[np.float64]

Residual = Callable[[Array], Array]
"""Parameters (n, p) of n particles to the norms of their residuals, (n,); NaN out of reach."""

Stop = Callable[[Array], bool]
"""Whether the search may end, by the best places so far, (iterations, p)."""


@dataclass(frozen=True)
class Box:
    """Where the parameters are looked for."""

    lower: Array  # (p,)
    upper: Array  # (p,)

    def __post_init__(self) -> None:
        """Refuse a box without inside, which no swarm could fill."""
        for j, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            if not (np.isfinite([low, high]).all() and low < high):
                raise InputError(
                    f"search box: parameter {j + 1} goes from {low:g} to {high:g}; both have to "
                    "be finite, the second above the first"
                )

    @classmethod
    def about_zero(cls, half_width: Array) -> Box:
        """|x_j| <= half_width_j."""
        return cls(-half_width, half_width)

    @property
    def middle(self) -> Array:
        """(p,)."""
        return (self.lower + self.upper) / 2

    @property
    def half_width(self) -> Array:
        """(p,)."""
        return (self.upper - self.lower) / 2

    def inside(self, scaled: Array) -> Array:
        """Places (..., p) of the box |x_j| <= 1 in this one."""
        return self.middle + scaled * self.half_width

    def scaled(self, place: Array) -> Array:
        """The inverse of `inside`."""
        return (place - self.middle) / self.half_width


@dataclass(frozen=True)
class Swarm:
    """n particles in the box |x_j| <= 1."""

    x: Array  # (n, p) places
    v: Array  # (n, p) last moves
    own: Array  # (n, p) best place of each
    norm: Array  # (n,) residual there

    @property
    def leader(self) -> Array:
        """The best place of all, (p,)."""
        return np.asarray(self.own[np.argmin(self.norm)])


class Law(Protocol):
    """How a swarm moves."""

    def move(self, swarm: Swarm, progress: float, rng: np.random.Generator) -> Array:
        """Next moves (n, p); `progress` goes from 0 to 1 over the search."""
        ...


@dataclass(frozen=True)
class Qpso:
    """Quantum-behaved: a particle is drawn about a point between its own best and the leader."""

    widest: float = 1.0  # contraction a at the beginning
    narrowest: float = 0.5  # and at the end

    def move(self, swarm: Swarm, progress: float, rng: np.random.Generator) -> Array:
        """Paper 004 (11)-(13)."""
        phi, u, sign = rng.random((3, *swarm.x.shape))
        contraction = self.widest + progress * (self.narrowest - self.widest)
        attractor = phi * swarm.own + (1 - phi) * swarm.leader
        reach = contraction * np.abs(swarm.own.mean(axis=0) - swarm.x) * -np.log1p(-u)
        return np.asarray(attractor + np.where(sign < 0.5, -reach, reach) - swarm.x)


@dataclass(frozen=True)
class Pso:
    """Inertia falls evenly; speed is bounded by a share of the box's width."""

    heaviest: float = 0.9
    lightest: float = 0.4
    cognitive: float = 2.0
    social: float = 2.0
    velocity_fraction: float = 0.1

    def move(self, swarm: Swarm, progress: float, rng: np.random.Generator) -> Array:
        """Paper 000 (10) with w by the clock."""
        w = self.heaviest + progress * (self.lightest - self.heaviest)
        return _velocity(swarm, w, self.cognitive, self.social, self.velocity_fraction, rng)


@dataclass(frozen=True)
class Apso:
    """Inertia follows the swarm's diversity along the diagonal of the box."""

    cognitive: float = 2.0
    social: float = 2.0
    velocity_fraction: float = 0.1

    def move(self, swarm: Swarm, progress: float, rng: np.random.Generator) -> Array:
        """Paper 000 (10)-(14)."""
        del progress
        w = float(inertia(diversity(swarm.x.mean(axis=1)[None]))[0])
        return _velocity(swarm, w, self.cognitive, self.social, self.velocity_fraction, rng)


@dataclass(frozen=True)
class SwarmSettings:
    """How large the swarm is and how long it searches: paper 004's N and t_max."""

    particles: int = 80
    iterations: int = 300
    law: Law = field(default_factory=Qpso)

    def __post_init__(self) -> None:
        """Refuse settings with which no search can be made."""
        for name, value, least in (
            ("particles", self.particles, 2),
            ("iterations", self.iterations, 1),
        ):
            if value != int(value) or value < least:
                raise InputError(
                    f"{name} is {value}; it has to be a whole number, at least {least}"
                )


@dataclass(frozen=True)
class SwarmResult:
    """Where a swarm ended."""

    best: Array  # (p,)
    norm: float  # residual there
    evaluations: int  # of the residual, a particle each
    history: Array  # (iterations,) least norm so far


def minimise(
    residual: Residual,
    box: Box,
    settings: SwarmSettings,
    rng: np.random.Generator,
    start: Array | None = None,
) -> SwarmResult:
    """Search the box for the least residual.

    Args:
        residual: parameters (n, p) to norms (n,).
        box: p intervals.
        settings: size, length, law.
        rng: source of all chance.
        start: (p,) where the first particle begins; by chance like the others where not given.

    Raises:
        DataError: no particle was ever where the residual exists.
    """
    return search(residual, box, settings, rng, start)[0]


def search(
    residual: Residual,
    box: Box,
    settings: SwarmSettings,
    rng: np.random.Generator,
    start: Array | None = None,
    stop: Stop | None = None,
) -> tuple[SwarmResult, Array]:
    """As `minimise`, with the best place after each iteration, (iterations, p), and an early end.

    `stop` and what is returned see the places in coordinates in which the box is |x_j| <= 1.

    Raises:
        DataError: as `minimise`.
    """
    x = rng.uniform(-1.0, 1.0, (settings.particles, len(box.lower)))
    if start is not None:
        x[0] = box.scaled(start)
    swarm = Swarm(x, np.zeros_like(x), x, np.full(len(x), np.inf))
    history, trace = [], np.empty((settings.iterations, x.shape[1]))
    for t in range(settings.iterations):
        if t:
            v = settings.law.move(swarm, (t - 1) / max(settings.iterations - 2, 1), rng)
            swarm = Swarm(np.clip(swarm.x + v, -1.0, 1.0), v, swarm.own, swarm.norm)
        swarm = _judged(swarm, residual(box.inside(swarm.x)))
        history.append(float(swarm.norm.min()))
        trace[t] = swarm.leader
        if stop is not None and stop(trace[: t + 1]):
            break
    if not np.isfinite(history[-1]):
        raise DataError("no particle of the swarm came where the machine can be assembled")
    count = settings.particles * len(history)
    found = SwarmResult(box.inside(swarm.leader), history[-1], count, np.array(history))
    return found, trace[: len(history)]


def _judged(swarm: Swarm, norm: Array) -> Swarm:
    """Each particle remembers its place if it is its best so far; NaN is never remembered."""
    better = norm < swarm.norm
    own = np.where(better[:, None], swarm.x, swarm.own)
    return Swarm(swarm.x, swarm.v, own, np.where(better, norm, swarm.norm))


def _velocity(
    swarm: Swarm, w: float, own: float, social: float, most: float, rng: np.random.Generator
) -> Array:
    """Paper 000 (10), bounded by `most` of the box's width, which is 2."""
    r1, r2 = rng.random((2, *swarm.x.shape))
    pull = own * r1 * (swarm.own - swarm.x) + social * r2 * (swarm.leader - swarm.x)
    return np.asarray(np.clip(w * swarm.v + pull, -2.0 * most, 2.0 * most))
