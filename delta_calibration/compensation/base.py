"""What every way of compensating has in common.

For a nominal joint command q and the tool point p* that it was meant to reach, a compensator finds

    dq with  point(q + dq) = p*,   |dq_j| <= bound,

where `point` is the model of the machine as it is. How the model was made is no concern of this layer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

PointFunction = Callable[[Array], Array]
"""Joint angles (..., m) [rad] to tool points (..., 3) [m]; NaN rows where out of reach."""

JacobianFunction = Callable[[Array], Array]
"""Joint angles (..., m) [rad] to d point / d q, (..., 3, m) [m/rad]."""


@dataclass(frozen=True)
class Correction:
    """What to add to each nominal command, and what the model says of the result.

    `error` is the distance that the *model* still has to the target after the correction: it says how well
    the search did, not how accurate the real machine is. It is infinite where nothing could be evaluated:
    a target or command that is not finite, or no reachable candidate; `dq` is zero there.
    """

    dq: Array  # (n, m) [rad]
    error: Array  # (n,) [m]
    evaluations: Counts  # (n,) evaluations of the model
    converged: Flags  # (n,) error within the tolerance

    @classmethod
    def none(cls, n: int, m: int) -> Correction:
        """Return the correction that corrects nothing: zero, with the error unknown."""
        return cls(
            dq=np.zeros((n, m)),
            error=np.full(n, np.inf),
            evaluations=np.zeros(n, dtype=np.int64),
            converged=np.zeros(n, dtype=np.bool_),
        )


class Compensator(Protocol):
    """One way to the correction; all ways answer the same question in the same form."""

    def correct(self, q: Array, target: Array) -> Correction:
        """Return dq for nominal commands q (n, m) [rad] and the points they mean, (n, 3) [m]."""
        ...


def checked_commands(q: Array, target: Array) -> tuple[Array, Array, Flags]:
    """Return commands (n, m) [rad], targets (n, 3) [m] and which rows of both are finite, (n,).

    Raises:
        InputError: if the shapes do not belong together.
    """
    q, target = np.asarray(q, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if q.ndim != 2 or q.shape[1] == 0:
        raise InputError(f"q has shape {q.shape}; it has to be (targets, joints)")
    if target.shape != (len(q), 3):
        raise InputError(f"target has shape {target.shape}; it has to be ({len(q)}, 3), a row of q each")
    return q, target, np.isfinite(q).all(axis=1) & np.isfinite(target).all(axis=1)


def distance(reached: Array, target: Array) -> Array:
    """Return f = |reached - target| (...,) [m], the fitness (9); infinite where out of reach.

    Args:
        reached: Tool points (..., 3) [m], NaN where the mechanism cannot go.
        target: Points meant (..., 3) [m].
    """
    d = reached - target
    f = np.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2 + d[..., 2] ** 2)
    return np.where(np.isfinite(f), f, np.inf)


def require_positive(name: str, value: float, unit: str) -> None:
    """Raise InputError unless the setting is finite and above zero."""
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name} is {value}; it has to be above 0 {unit}".rstrip())


def require_at_least(name: str, value: int, least: int) -> None:
    """Raise InputError unless the setting is a whole number not below `least`."""
    if value != int(value) or value < least:
        raise InputError(f"{name} is {value}; it has to be a whole number, at least {least}")
