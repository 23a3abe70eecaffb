"""Particle swarms that minimise a residual over parameters: QPSO, PSO, APSO.

A swarm needs only the residual's norm, no derivative; all its particles are evaluated together.
Laws of motion of the particles, in coordinates in which the search box is |x_j| <= 1, with p_i the
best position of particle i so far, g the best of all particles, r, phi, u uniform in [0, 1]:

    QPSO   x_i = phi p_i + (1 - phi) g +- a |c - x_i| ln(1/u),  c the mean of all p_i
    PSO    v_i = w v_i + c1 r1 (p_i - x_i) + c2 r2 (g - x_i),   x_i = x_i + v_i
    APSO   as PSO, with w from the swarm's own diversity

QPSO is paper 004 (11)-(13), with the contraction a falling linearly from 1 to 0.5; PSO has w
falling linearly as well; APSO is paper 000 (10)-(14).
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
    """The search box: an interval for each parameter."""

    lower: Array  # (p,)
    upper: Array  # (p,)

    def __post_init__(self) -> None:
        """Refuse a box without volume, which no swarm could fill."""
        for j, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            if not (np.isfinite([low, high]).all() and low < high):
                raise InputError(
                    f"search box: parameter {j + 1} goes from {low:g} to {high:g}; both must be "
                    "finite, and the second larger than the first"
                )

    @classmethod
    def about_zero(cls, half_width: Array) -> Box:
        """The box |x_j| <= half_width_j, half_width (p,)."""
        return cls(-half_width, half_width)

    @property
    def middle(self) -> Array:
        """Middle of each interval, (p,)."""
        return (self.lower + self.upper) / 2

    @property
    def half_width(self) -> Array:
        """Half the width of each interval, (p,)."""
        return (self.upper - self.lower) / 2

    def inside(self, scaled: Array) -> Array:
        """Map positions (..., p) from the box |x_j| <= 1 to this box."""
        return self.middle + scaled * self.half_width

    def scaled(self, place: Array) -> Array:
        """The inverse of `inside`."""
        return (place - self.middle) / self.half_width


@dataclass(frozen=True)
class Swarm:
    """State of n particles in the box |x_j| <= 1."""

    x: Array  # (n, p) positions
    v: Array  # (n, p) last moves
    own: Array  # (n, p) best position of each
    norm: Array  # (n,) residual there

    @property
    def leader(self) -> Array:
        """Best position of all particles, (p,)."""
        return np.asarray(self.own[np.argmin(self.norm)])


class Law(Protocol):
    """Law of motion of a swarm."""

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
    """Standard: inertia falls linearly; speed is bounded by a share of the box's width."""

    heaviest: float = 0.9
    lightest: float = 0.4
    cognitive: float = 2.0
    social: float = 2.0
    velocity_fraction: float = 0.1

    def move(self, swarm: Swarm, progress: float, rng: np.random.Generator) -> Array:
        """Paper 000 (10) with w as a function of progress."""
        w = self.heaviest + progress * (self.lightest - self.heaviest)
        return _velocity(swarm, w, self.cognitive, self.social, self.velocity_fraction, rng)


@dataclass(frozen=True)
class Apso:
    """Adaptive: inertia follows the swarm's diversity along the diagonal of the box."""

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
    """Number of particles and iterations (paper 004's N and t_max), and law of motion."""

    particles: int = 80
    iterations: int = 300
    law: Law = field(default_factory=Qpso)

    def __post_init__(self) -> None:
        """Refuse numbers that are not whole or too small."""
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
    """Result of a swarm search."""

    best: Array  # (p,) best parameters
    norm: float  # norm of the residual there
    evaluations: int  # of the residual, one per particle and iteration
    history: Array  # (iterations,) smallest norm so far


def minimise(
    residual: Residual,
    box: Box,
    settings: SwarmSettings,
    rng: np.random.Generator,
    start: Array | None = None,
) -> SwarmResult:
    """Search the box for the parameters with the smallest residual.

    Args:
        residual: parameters (n, p) to norms (n,).
        box: p intervals.
        settings: number of particles and iterations, law of motion.
        rng: random generator.
        start: initial position of the first particle, (p,); random by default, like the others.

    Raises:
        DataError: the residual did not exist at any position of any particle.
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
    """As `minimise`, but returns the best position after each iteration too, and may stop early.

    `stop` receives, and the second result holds, positions (iterations, p) in coordinates in which
    the box is |x_j| <= 1.

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
        raise DataError(
            "no particle of the swarm reached parameters with which the machine can be assembled"
        )
    count = settings.particles * len(history)
    found = SwarmResult(box.inside(swarm.leader), history[-1], count, np.array(history))
    return found, trace[: len(history)]


def _judged(swarm: Swarm, norm: Array) -> Swarm:
    """Update the best position of each particle; a NaN residual never counts as better."""
    better = norm < swarm.norm
    own = np.where(better[:, None], swarm.x, swarm.own)
    return Swarm(swarm.x, swarm.v, own, np.where(better, norm, swarm.norm))


def _velocity(
    swarm: Swarm, w: float, own: float, social: float, most: float, rng: np.random.Generator
) -> Array:
    """Moves by paper 000 (10), bounded by the share `most` of the box's width, which is 2."""
    r1, r2 = rng.random((2, *swarm.x.shape))
    pull = own * r1 * (swarm.own - swarm.x) + social * r2 * (swarm.leader - swarm.x)
    return np.asarray(np.clip(w * swarm.v + pull, -2.0 * most, 2.0 * most))
