"""Residuals of measured poses as a function of the geometry, cheap enough for swarms.

With joints q_i, measured poses x_i, closure equations f and nominal geometry g_0, one Newton step
from the measured pose gives the pose error without solving the forward kinematics,

    e_i(d) = W_i f_x(q_i, x_i, g_0)^-1 f(q_i, x_i, g_0 + P d),

which is zero exactly if the machine g_0 + P d takes the measured pose. W weights positions against
angles, P inserts the deviations d of the free parameters. The error model of paper 004 (6) is its
linearisation, e(d) = e(0) - J d: the same sum of squares from p rows instead of n k.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError, InputError
from delta_calibration.lazy import cached_property
from delta_calibration.mechanisms import Mechanism
from delta_calibration.mechanisms.base import solve
from delta_calibration.papers.swarm import Box, SwarmResult

Array = NDArray[np.float64]


_NONE = 1e-8  # singular values under this share of the largest count as zero

Search = Callable[["LinearResidual", Box], SwarmResult]


@dataclass(frozen=True)
class PoseResidual:
    """Residual of poses (n, k), measured in the mechanism's base frame at joints (n, m)."""

    mechanism: Mechanism
    joint: Array  # (n, m)
    pose: Array  # (n, k), measured
    weight: Array  # (n, k, k): 1/m, 1/rad, or m/rad to compare angles with positions
    free: NDArray[np.intp]  # (p,) rows of the free parameters

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together, and too few poses for the free parameters."""
        n, k = len(self.joint), self.mechanism.pose_size
        if self.pose.shape != (n, k) or self.weight.shape != (n, k, k):
            raise InputError(
                f"poses {self.pose.shape} and weights {self.weight.shape} do not go with {n} "
                f"joint vectors of {self.mechanism.name}; ({n}, {k}) and ({n}, {k}, {k}) do"
            )
        if n * k < len(self.free):
            raise DataError(f"{n} poses of {k} coordinates do not set {len(self.free)} parameters")
        for what, values in (("joints", self.joint), ("pose", self.pose)):
            bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
            if bad.size:
                raise InputError(f"measured {what} {bad[0] + 1} are not finite: {values[bad[0]]}")

    def errors(self, deviation: Array) -> Array:
        """Weighted pose errors e, (K, n k), of K machines with these deviations, (K, p)."""
        n, particles = len(self.joint), len(deviation)
        geometry = np.tile(self.mechanism.parameters.nominal, (particles, 1))
        geometry[:, self.free] += deviation
        f = self.mechanism.closure(
            np.tile(self.joint, (particles, 1)),
            np.tile(self.pose, (particles, 1)),
            np.repeat(geometry, n, axis=0),
        )
        step = np.einsum("nkr,anr->ank", self._step, f.reshape(particles, n, -1))
        return np.asarray(step.reshape(particles, -1))

    def __call__(self, deviation: Array) -> Array:
        """Norms |e| for K machines with these deviations, (K,)."""
        return np.asarray(np.linalg.norm(self.errors(deviation), axis=1))

    def jacobian(self, deviation: Array) -> Array:
        """-de/dd, (n k, p), at one deviation (p,)."""
        geometry = self.mechanism.parameters.nominal
        geometry[self.free] += deviation
        slope = self.mechanism.closure_by_geometry(self.joint, self.pose, geometry)
        return np.asarray(-(self._step @ slope[:, :, self.free]).reshape(-1, len(self.free)))

    def linear(self, deviation: Array) -> LinearResidual:
        """The error model linearised about a deviation (p,)."""
        slope = self.jacobian(deviation)
        return LinearResidual.of(slope, self.errors(deviation[None])[0] + slope @ deviation)

    @cached_property
    def _step(self) -> Array:
        """W f_x^-1 at the nominal geometry, (n, k, r)."""
        nominal = self.mechanism.parameters.nominal
        by_pose = self.mechanism.closure_by_pose(self.joint, self.pose, nominal)
        rows = np.broadcast_to(np.eye(by_pose.shape[1]), (len(by_pose), *2 * by_pose.shape[1:2]))
        return self.weight @ solve(by_pose, rows)


@dataclass(frozen=True)
class LinearResidual:
    """Norm |J d - e| in reduced form: |R d - c| with J = Q R, and the part that no d changes."""

    factor: Array  # R, (p, p)
    target: Array  # c, (p,)
    rest: float

    @classmethod
    def of(cls, slope: Array, error: Array) -> LinearResidual:
        """Reduce J (rows, p) and e (rows,) by a QR decomposition."""
        basis, factor = np.linalg.qr(slope)
        target = basis.T @ error
        return cls(factor, target, float(np.linalg.norm(error - basis @ target)))

    def __call__(self, deviation: Array) -> Array:
        """Norms for K vectors d, (K, p) -> (K,)."""
        left = deviation @ self.factor.T - self.target
        return np.asarray(np.sqrt(np.sum(left**2, axis=1) + self.rest**2))


def in_rounds(residual: PoseResidual, box: Box, search: Search, rounds: int) -> SwarmResult:
    """Search the error model about the nominal geometry, then again about each result.

    A single round is the paper's method: it neglects second-order terms of the errors.

    Raises:
        DataError: as the search.
    """
    parts: list[SwarmResult] = []
    best = np.zeros(len(residual.free))
    for _ in range(rounds):
        parts.append(search(residual.linear(best), box))
        best = parts[-1].best
    history = np.concatenate([part.history for part in parts])
    evaluations = sum(part.evaluations for part in parts)
    return SwarmResult(best, float(residual(best[None])[0]), evaluations, history)


def least_squares(residual: LinearResidual, box: Box) -> SwarmResult:
    """Minimise the error model by linear least squares, for `in_rounds`: Gauss-Newton.

    The box is no bound but scales the parameters: combinations that are not identifiable stay at
    its middle.
    """
    missed = residual.target - residual.factor @ box.middle
    step = np.linalg.lstsq(residual.factor * box.half_width, missed, rcond=_NONE)[0]
    best = np.asarray(box.middle + step * box.half_width, dtype=float)
    norm = float(residual(best[None])[0])
    return SwarmResult(best, norm, 1, np.array([norm]))
