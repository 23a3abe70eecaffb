"""Interface, result and checks that all compensation methods share.

For a nominal joint command q and the tool point p* that it was meant to reach, a compensator finds

    dq with  point(q + dq) = p*,   |dq_j| <= bound,

where `point` is the model of the actual machine, no matter how it was identified. Where the
joints rotate the tool as well, the point has more coordinates: see task_coordinates.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError

REACHED = 1e-6  # [m] error by the model; a correction that ends farther off counts as none

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

PointFunction = Callable[[Array], Array]
"""Joint angles (..., m) [rad] to tool points (..., d) [m]; NaN rows where out of reach.

Every row is treated alike: rows come in any number and order and drop out when done. What
differs between commands (payload, temperature, direction) is fixed inside: one function for each.
"""


@dataclass(frozen=True)
class Correction:
    """Corrections to add to nominal commands, and their errors by the model.

    `error` is the distance that the *model* still has to the target after the correction: it tells
    how well the search converged, not how accurate the real machine is. It is infinite where
    nothing could be evaluated (a target or command that is not finite, no candidate in reach);
    `dq` is zero there.
    """

    dq: Array  # (n, m) [rad]
    error: Array  # (n,) [m]
    evaluations: Counts  # (n,) evaluations of the model
    converged: Flags  # (n,) error within the tolerance

    @classmethod
    def none(cls, n: int, m: int) -> Correction:
        """Return n zero corrections of m joints, with infinite error."""
        return cls(
            dq=np.zeros((n, m)),
            error=np.full(n, np.inf),
            evaluations=np.zeros(n, dtype=np.int64),
            converged=np.zeros(n, dtype=np.bool_),
        )

    def spread(self, usable: Flags) -> Correction:
        """Return corrections of all n rows: these where `usable` (n,), zero ones elsewhere."""
        if usable.all():
            return self
        whole = Correction.none(len(usable), self.dq.shape[1])
        whole.dq[usable] = self.dq
        whole.error[usable] = self.error
        whole.evaluations[usable] = self.evaluations
        whole.converged[usable] = self.converged
        return whole


class Compensator(Protocol):
    """Interface of a compensation method."""

    def correct(self, q: Array, target: Array) -> Correction:
        """Return dq for nominal commands q (n, m) [rad] and their target points (n, d) [m]."""
        ...


def joined(parts: Iterable[Correction], m: int) -> Correction:
    """Concatenate corrections of m joints."""
    every = [Correction.none(0, m), *parts]
    return Correction(
        dq=np.concatenate([part.dq for part in every]),
        error=np.concatenate([part.error for part in every]),
        evaluations=np.concatenate([part.evaluations for part in every]),
        converged=np.concatenate([part.converged for part in every]),
    )


def checked_commands(
    q: Array, target: Array, size: int | None = None
) -> tuple[Array, Array, Flags]:
    """Return commands (n, m) [rad], targets (n, d) [m] and which rows of both are finite, (n,).

    Args:
        q: Commands.
        target: Targets.
        size: Required d; any if not given.

    Raises:
        InputError: if the shapes do not match.
    """
    q, target = np.asarray(q, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if q.ndim != 2 or q.shape[1] == 0:
        raise InputError(f"q has shape {q.shape}; it has to be (targets, joints)")
    size = target.shape[-1] if size is None and target.ndim else size
    if target.shape != (len(q), size):
        raise InputError(
            f"target has shape {target.shape}; it has to be ({len(q)}, {size}), a row for each "
            "of q"
        )
    usable: Flags = np.all(np.isfinite(np.hstack([q, target])), axis=1)
    return q, target, usable


def distance(gap: Array) -> Array:
    """Return f = |gap| (...,) [m], the fitness (9); infinite where the gap is not finite.

    Args:
        gap: Point reached less point meant (..., d) [m]; NaN where the mechanism cannot go.
    """
    f = np.sqrt(sum(gap[..., k] ** 2 for k in range(gap.shape[-1])))
    return np.where(np.isfinite(f), f, np.inf)


def require_positive(name: str, value: float, unit: str = "") -> None:
    """Raise InputError unless the setting is finite and above zero."""
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name} is {value}; it has to be finite and above 0 {unit}".rstrip())


def require_whole(name: str, value: int, least: int) -> None:
    """Raise InputError unless the setting is a whole number not below `least`."""
    if not np.isfinite(value) or value != int(value) or value < least:
        raise InputError(f"{name} is {value}; it has to be a whole number, at least {least}")
