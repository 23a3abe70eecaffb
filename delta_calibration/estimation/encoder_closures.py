"""Self-calibration of a redundant mechanism from its joint readings alone, with encoder noise.

With more closures r than coordinates k of the pose, r - k combinations of them hold at any pose:
N^T f = 0 with N, (r, r - k), the left null space of f_x. The joints q that were read are joints q'
at which the machine closes, plus encoder noise. The nearest q' is

    min |q' - q|   with   f(q', x, g) = 0   for some x

With L L^T = N^T f_q f_q^T N and A = L^-1 N^T f_q, whose rows are orthonormal, q - q' lies in their
span. The residual is e = A (q - q'): r - k numbers with the standard deviation of the encoders,
and de/dg = L^-1 N^T f_g. Cable robots (m > n) and encoders on passive joints give such data.

`ClosureWithoutPose` (`closures.py`) weights the same misfit differently: its noise is that of the
closures, equal in each, and the joints have none. The two agree only if every joint enters its
closure with the same slope: with drums of unequal gear ratio an encoder error moves one cable
farther than another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Predictor
from delta_calibration.errors import InputError
from delta_calibration.estimation.closures import unmoved
from delta_calibration.estimation.measurements import (
    Linear,
    Observation,
    require_shapes,
    standing,
    through_closures,
)
from delta_calibration.mechanisms import Mechanism

Array = NDArray[np.float64]

_STEPS = 10
_SETTLED = 1e-9  # last step over the residual, or the noise, at which the iteration has converged


@dataclass(frozen=True)
class EncoderClosure(Observation):
    """Joint readings of a redundant mechanism, which must close within the encoders' noise.

    They do not determine the machine's position and orientation nor, if only lengths enter, its
    size: a model and its copy of twice the size close equally. No device, no frame; unidentifiable
    parameters keep their priors (without any, they are in `MixedFit.unset`).
    """

    kind: ClassVar[str] = "none"

    joint: Array
    redundancy: int  # r - k numbers a pose
    noise: float  # [rad, m] of each joint

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        require_shapes(self)

    @classmethod
    def of(cls, mechanism: Mechanism, joint: Array, noise: float) -> EncoderClosure:
        """Build it from joints (n, m) [rad, m] of a redundant mechanism.

        Raises:
            InputError: the mechanism is not redundant, or its joints do not enter all closures.
        """
        home, g = mechanism.home[None], mechanism.parameters.nominal
        x = mechanism.start(home, g)
        rows, size = mechanism.closure_by_pose(home, x, g).shape[1:]
        spare = rows - size
        if spare <= 0:
            raise InputError(
                f"none: {mechanism.name} has {rows} closures for {size} coordinates of the pose, "
                "and closes at any joints; a redundant mechanism is needed, or something measured"
            )
        free = unmoved(mechanism.closure_by_pose(home, x, g))
        entered = np.swapaxes(free, 1, 2) @ mechanism.closure_by_joints(home, x, g)
        if np.linalg.matrix_rank(entered[0]) < spare:
            raise InputError(
                f"none: joints occur in {np.linalg.matrix_rank(entered[0])} of the {spare} "
                "closures "
                f"that {mechanism.name} has to spare; all of them are needed"
            )
        return cls(joint, spare, noise)

    @property
    def sigma(self) -> Array:
        """Standard deviation of each number of e, (r - k,) [rad, m]."""
        return np.full(self.redundancy, self.noise)

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals 0 - e, (n, r - k) [rad, m], and their slopes; NaN rows out of reach."""
        seen, g = standing(at, theta, guess)
        mechanism = at.chain.mechanism
        e, q, x, white = self._closed(mechanism, seen.joint, g)
        by_joints = white @ mechanism.closure_by_joints(q, x, g)
        by_geometry = white @ mechanism.closure_by_geometry(q, x, g)
        slope = through_closures(at, theta, by_joints, by_geometry)
        return Linear(x, -e, slope, by_joints, at.at)

    def _closed(
        self, mechanism: Mechanism, read: Array, g: Array
    ) -> tuple[Array, Array, Array, Array]:
        """e, (n, r - k); q', (n, m); x, (n, k); and L^-1 N^T there, (n, r - k, r).

        Newton's method on q': each step takes the nearest joints that close to first order.
        """
        q = read
        for _ in range(_STEPS):
            x = mechanism.forward(q, g)
            white = _whitened(mechanism, q, x, g)
            along = white @ mechanism.closure_by_joints(q, x, g)
            left = (white @ mechanism.closure(q, x, g)[..., None])[..., 0]
            e = left + (along @ (read - q)[..., None])[..., 0]
            nearest = read - (np.swapaxes(along, 1, 2) @ e[..., None])[..., 0]
            step, q = np.abs(nearest - q), nearest
            if np.nan_to_num(step).max() <= _SETTLED * max(np.nanmax(np.abs(e)), self.noise):
                break
        return e, q, x, white


def _whitened(mechanism: Mechanism, q: Array, x: Array, g: Array) -> Array:
    """L^-1 N^T, (n, r - k, r); NaN rows out of reach."""
    known = np.isfinite(x).all(axis=1)
    across = np.swapaxes(unmoved(mechanism.closure_by_pose(q[known], x[known], g)), 1, 2)
    entered = across @ mechanism.closure_by_joints(q[known], x[known], g)
    root = np.linalg.cholesky(entered @ np.swapaxes(entered, 1, 2))
    white = np.full((len(x), *across.shape[1:]), np.nan)
    white[known] = np.linalg.solve(root, across)
    return white
