"""Nothing measured but the joints, by encoders with noise: a redundant mechanism that must close.

With more closures r than coordinates k of the pose, r - k combinations of them hold whatever the
pose: N^T f = 0 with N, (r, r - k), the left null space of f_x. The joints q that were read are
those of a machine that closes, q', and encoders' noise. The nearest such q' is

    min |q' - q|   with   f(q', x, g) = 0   for some x

and, with L L^T = N^T f_q f_q^T N and A = L^-1 N^T f_q, whose rows are orthonormal, all of q - q'
lies in them: e = A (q - q'), as many numbers as there are to spare, of the encoders' own standard
deviation, and de/dg = L^-1 N^T f_g. Cables have it (m > n), and encoders on passive joints.

`ClosureWithoutPose` (`closures.py`) weighs the same misfit otherwise: the parts between the joints
have the noise, alike in every closure, and the joints none. The two agree where every joint enters
its closure by the same slope, and only there: with drums of unequal gear an error of the encoder
moves one cable farther than another.
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
_SETTLED = 1e-9  # a last step so small beside what is missed is none


@dataclass(frozen=True)
class EncoderClosure(Observation):
    """The joints of a redundant mechanism, which a pose has to fit within their encoders' noise.

    Says nothing of where the machine stands, how it is turned and, where only lengths enter, how
    large it is: a model and its copy at twice the size close alike. No device, no frame; what does
    not show stays with its prior (`MixedFit.unset` where there is none).
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
        """Of joints (n, m) [rad, m] of a redundant mechanism.

        Raises:
            InputError: not redundant, or closures that its joints do not enter.
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
                f"none: joints enter {np.linalg.matrix_rank(entered[0])} of the {spare} closures "
                f"that {mechanism.name} has to spare; all of them are needed"
            )
        return cls(joint, spare, noise)

    @property
    def sigma(self) -> Array:
        """(r - k,) [rad, m]."""
        return np.full(self.redundancy, self.noise)

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Nothing less e, (n, r - k) [rad, m]; NaN rows out of reach."""
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

        Newton's method on q', each step the nearest joints that close to first order.
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
