"""The least-squares problem: whitened residuals of the chain, and priors as rows.

The unknowns are scaled, theta = theta_0 + S z, with the priors' standard deviations (a typical
size where there is no prior) on the diagonal of S, so that z is of the order of one and the
prior's rows are z itself. S also shifts the tracker's frame against the reflector's offset: on a
platform that hardly tilts the two are nearly equivalent, and without this coupling the search
would move very slowly along that valley of the cost.

    minimise  sum_i rho(|W_i (y_i - chain(q_i, theta))|) / s^2 + sum_prior z_k^2

with the robust loss rho of `solver.py`, which searches the minimum.

Measurements may be of several kinds (`measurements.py`) with d numbers each: 3 of a position, 6 of
a pose. With poses, the orientation of the probe's mount adds three unknowns to those of the chain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain, Predictor
from delta_calibration.data import Conditions, joined
from delta_calibration.estimation.measurements import Linear, Measured, PointMeasured
from delta_calibration.lazy import cached_property
from delta_calibration.theta import Layout, vector_names

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

_FRAME_STEP = 1e-3  # typical size of a parameter without prior [m, rad]
_KEPT = 300_000  # samples times unknowns, up to which their Jacobian is kept
_BLOCK = 256  # samples whose Jacobian is computed at a time otherwise
MOUNT_NAMES = vector_names("probe_turn")


@dataclass(frozen=True)
class Kept:
    """Jacobian of the whitened prediction by the free unknowns, in memory."""

    slope: Array  # (n, d, F)

    @property
    def rows(self) -> Array:
        """All rows, (n d, F)."""
        return self.slope.reshape(-1, self.slope.shape[2])

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Samples and their rows: all at once."""
        yield slice(None), self.rows

    def take(self, samples: NDArray[np.intp]) -> Kept:
        """The Jacobian of some of the samples."""
        return Kept(self.slope[samples])


@dataclass(frozen=True)
class Recomputed:
    """The Jacobian of many samples by many unknowns, computed block by block when needed."""

    problem: Problem
    theta: Array  # (P,)
    pose: Array  # (n, k)

    @property
    def rows(self) -> Array:
        """All rows, (n d, F)."""
        return np.concatenate([rows for _, rows in self.blocks()])

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Samples and their rows, block by block."""
        for own, linear in self.problem.in_blocks(self.theta, self.pose):
            yield own, self.problem.whitened(linear, own)[1]

    def take(self, samples: NDArray[np.intp]) -> Recomputed:
        """The Jacobian of some of the samples."""
        return Recomputed(self.problem.take(samples), self.theta, self.pose[samples])


@dataclass(frozen=True)
class Linearized:
    """A problem linearized at theta, d numbers a sample; kinds with fewer are zero-padded."""

    pose: Array  # (n, k) of the platform
    residual: Array  # (n, d) whitened: measured less predicted
    jacobian: Kept | Recomputed
    numbers: Index  # (n,) how many of the d numbers each sample has

    @property
    def rows(self) -> Array:
        """Rows of the Jacobian, whitened d(predicted)/dz of the free unknowns, (n d, F)."""
        return self.jacobian.rows

    @property
    def slope(self) -> Array:
        """The Jacobian rows grouped by pose, (n, d, F)."""
        return self.rows.reshape(*self.residual.shape, -1)

    def take(self, samples: NDArray[np.intp]) -> Linearized:
        """Some of the samples."""
        residual, numbers = self.residual[samples], self.numbers[samples]
        jacobian = self.jacobian.take(samples)
        return Linearized(self.pose[samples], residual, jacobian, numbers)


@dataclass(frozen=True)
class Near:
    """Start of a search: unknowns z (F,), and the problem linearized there if that is known."""

    z: Array
    at: Linearized | None = None


@dataclass(frozen=True)
class Problem:
    """Estimation problem: a chain, its measurements, priors and free parameters."""

    chain: Chain
    measured: tuple[Measured, ...]  # one kind each, n samples in all
    theta0: Array  # (P,) prior mean and start
    basis: Array  # (P, P), S
    has_prior: Mask  # (P,)
    free: Mask  # (P,) fitted entries; the others keep their theta0

    @cached_property
    def layout(self) -> Layout:
        """Layout of theta: which entry is which parameter."""
        chain = self.chain.layout
        return chain if len(self.theta0) == chain.size else chain.mounted

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of theta, (P,)."""
        names = self.chain.parameters.names
        return (
            names
            if not self.layout.has_mount
            else (
                *names[: self.layout.mount.start],
                *MOUNT_NAMES,
                *names[self.layout.mount.start :],
            )
        )

    @cached_property
    def at(self) -> Conditions:
        """Conditions of all n samples."""
        return joined(*(part.at for part in self.measured))

    @cached_property
    def whiten(self) -> Array:
        """Whitening matrices if one kind was measured, (n, d, d) [1/m, 1/rad]."""
        (part,) = self.measured
        return part.whiten

    @cached_property
    def y(self) -> Array:
        """Measured positions if these are the only kind, (n, 3) [m] in the tracker's frame."""
        (part,) = self.measured
        return cast(PointMeasured, part.observation).point

    def mounted(self, measured: Measured, mount: Array) -> Problem:
        """Return the problem of a probe's poses, with its mounting orientation as an unknown.

        Args:
            measured: poses of the probe.
            mount: start value of the mounting orientation, rotation vector (3,) [rad].
        """
        layout = self.chain.layout.mounted
        own = layout.chain
        start, basis = np.zeros(layout.size), np.diag(np.full(layout.size, _FRAME_STEP))
        start[layout.mount], start[own] = mount, self.theta0
        basis[np.ix_(own, own)] = self.basis
        has_prior, free = np.zeros(layout.size, dtype=bool), np.ones(layout.size, dtype=bool)
        has_prior[own], free[own] = self.has_prior, self.free
        return Problem(self.chain, (measured,), start, basis, has_prior, free)

    def take(self, rows: NDArray[np.intp]) -> Problem:
        """Return the problem with some of the samples."""
        parts, begin = [], 0
        for part in self.measured:
            own = rows[(rows >= begin) & (rows < begin + len(part.at))] - begin
            parts.append(part.take(own))
            begin += len(part.at)
        return replace(self, measured=tuple(parts))

    def only(self, free: Mask) -> Problem:
        """Return the problem with other parameters free."""
        return replace(self, free=free)

    def theta(self, z: Array) -> Array:
        """Return theta (P,) for scaled free unknowns z (F,)."""
        return np.asarray(self.theta0 + self._freed @ z)

    def unknowns(self, theta: Array) -> Array:
        """Return the scaled free unknowns z (F,) for theta (P,); the inverse of `theta`."""
        return np.asarray(np.linalg.solve(self.basis, theta - self.theta0)[self.free])

    @cached_property
    def _predictors(self) -> tuple[Predictor, ...]:
        return tuple(self.chain.predictor(part.at) for part in self.measured)

    def about(self, theta: Array, guess: Array | None = None) -> tuple[Linear, ...]:
        """Each kind's measurements linearized at theta, not whitened; see `linearized`."""
        if len(self.measured) > 1:
            guess = None
        return tuple(
            part.observation.linearized(at, theta, guess)
            for part, at in zip(self.measured, self._predictors, strict=True)
        )

    def linearized(self, theta: Array, guess: Array | None = None) -> Linearized:
        """Return the whitened residuals at theta and their Jacobian.

        Args:
            theta: (P,).
            guess: approximate poses of the platform, (n, k); searched if not given.
        """
        if len(self.blocks) > 1:
            return self._left(theta, guess)
        parts = []
        for kind, linear in enumerate(self.about(theta, guess)):
            residual, rows = self.whitened(linear, slice(None), kind)
            numbers = np.full(len(residual), residual.shape[1])
            slope = rows.reshape(*residual.shape, rows.shape[1])
            parts.append(Linearized(linear.pose, residual, Kept(slope), numbers))
        return parts[0] if len(parts) == 1 else _stacked(parts)

    @cached_property
    def blocks(self) -> tuple[slice, ...]:
        """Samples to linearize at a time: several blocks if the Jacobian is too large to keep."""
        n, width = sum(len(part.at) for part in self.measured), int(self.free.sum())
        if len(self.measured) > 1 or n * width <= _KEPT:
            return (slice(None),)
        return tuple(slice(begin, begin + _BLOCK) for begin in range(0, n, _BLOCK))

    def in_blocks(self, theta: Array, guess: Array | None) -> Iterator[tuple[slice, Linear]]:
        """Measurements of one kind linearized at theta, block by block; see `about`."""
        (part,), (at,) = self.measured, self._predictors
        for own in self.blocks:
            near = None if guess is None else guess[own]
            yield own, part.observation.take(own).linearized(at.take(own), theta, near)

    def whitened(self, linear: Linear, samples: slice, kind: int = 0) -> tuple[Array, Array]:
        """Whitened residuals (n, d) and Jacobian rows (n d, F) of samples of one kind."""
        whiten = self.measured[kind].whiten[samples]
        slope = np.ascontiguousarray(linear.by_theta)
        residual, rows = equations().whitened(linear.missed, slope, whiten, self._freed)
        return residual, rows

    def _left(self, theta: Array, guess: Array | None) -> Linearized:
        """The whitened residuals of one kind; their Jacobian when it is needed."""
        (part,), (at,) = self.measured, self._predictors
        pose, missed = part.observation.left(at, theta, guess)
        residual = (part.whiten @ missed[..., None])[..., 0]
        numbers = np.full(len(residual), residual.shape[1])
        return Linearized(pose, residual, Recomputed(self, theta, pose), numbers)

    @cached_property
    def _freed(self) -> Array:
        """d(theta)/dz of the free unknowns, (P, F)."""
        return np.ascontiguousarray(self.basis[:, self.free])

    @cached_property
    def expected(self) -> Array:
        """1 for free unknowns that have a prior, else 0, (F,)."""
        return self.has_prior[self.free].astype(float)

    def offset_rows(self) -> Mask:
        """Mask of the free unknowns that are the reflector's offset, (F,)."""
        return np.asarray(self.layout.mask(self.layout.offset)[self.free])


def build_problem(chain: Chain, measured: Measured, start: Array) -> Problem:
    """Build a tracker's problem, all parameters free, scales and priors from the chain."""
    basis, finite = scales(chain)
    basis[chain.layout.place, chain.layout.offset] = (
        -chain.split(start)[2].rotation * chain.offset_prior
    )
    return Problem(chain, (measured,), start, basis, finite, np.ones(len(finite), dtype=bool))


def scales(chain: Chain) -> tuple[Array, Mask]:
    """Typical sizes of theta as a diagonal (P, P), and mask (P,) of entries with a prior."""
    prior = chain.parameters.prior
    finite = np.isfinite(prior)
    return np.diag(np.where(finite, prior, _FRAME_STEP)), finite


def widened(each: Array, width: int) -> Array:
    """Samples (n, d, ...) padded with zeros to `width` numbers d each."""
    missing = width - each.shape[1]
    return np.pad(each, [(0, 0), (0, missing)] + [(0, 0)] * (each.ndim - 2))


def _stacked(parts: list[Linearized]) -> Linearized:
    """Stack the parts of all kinds, padded to the largest d."""
    width = max(part.residual.shape[1] for part in parts)
    slope = np.concatenate([widened(part.slope, width) for part in parts])
    return Linearized(
        np.concatenate([part.pose for part in parts]),
        np.concatenate([widened(part.residual, width) for part in parts]),
        Kept(slope),
        np.concatenate([part.numbers for part in parts]),
    )


def equations() -> Any:
    """The compiled normal equations; numba is loaded with the first use."""
    from delta_calibration.estimation import normal_equations

    return normal_equations
