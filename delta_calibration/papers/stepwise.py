"""Swarms that search parameters one after the other: paper 004, or along singular vectors.

The paper's method: search all parameters, freeze the first whose best value has settled, search
the others again, until none is left; then search all together from there. Strongly correlated
parameters settle together, on wrong values.

Along the singular vectors of the identification Jacobian J = U S V^T,

    |J d - e|^2 = sum_k (s_k c_k - u_k . e)^2 + rest,   d = V c,

the coordinates c_k are uncorrelated: each is searched alone, the strongest first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.papers.swarm import (
    Box,
    Residual,
    SwarmResult,
    SwarmSettings,
    minimise,
    search,
)

Array = NDArray[np.float64]

_NONE = 1e-8  # singular values under this share of the largest count as zero


@dataclass(frozen=True)
class Settled:
    """Rule that decides when a parameter's best value has settled.

    It has moved by no more than `tolerance` of its interval in `window` iterations. The paper
    requires such a rule but does not state it.
    """

    window: int = 50
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        """Refuse a rule that is always or never met."""
        if self.window < 2 or not 0.0 <= self.tolerance < 1.0:
            raise InputError(
                f"settled in a window of {self.window} within {self.tolerance}: the first has to "
                "be 2 or more, the second in [0, 1)"
            )

    def moved(self, trace: Array) -> Array:
        """Range of each best value in the last window, (p,), as a share of its interval, 2."""
        return np.asarray(np.ptp(trace[-self.window :], axis=0) / 2)

    def by_any(self, trace: Array) -> bool:
        """Whether at least one parameter has settled."""
        return len(trace) >= self.window and bool((self.moved(trace) <= self.tolerance).any())


def stepwise(
    residual: Residual,
    box: Box,
    settings: SwarmSettings,
    rng: np.random.Generator,
    settled: Settled | None = None,
) -> SwarmResult:
    """Search parameters one by one, each frozen as soon as it has settled, then all together.

    At most p + 1 searches of `settings`.

    Raises:
        InputError: as `minimise`.
        DataError: as `minimise`.
    """
    rule = settled or Settled()
    best, left = box.middle.copy(), np.arange(len(box.lower))
    parts = []
    while left.size:
        part, trace = search(
            _among(residual, best, left), _some(box, left), settings, rng, stop=rule.by_any
        )
        parts.append(part)
        first = int(np.argmin(rule.moved(trace)))
        best[left[first]] = part.best[first]
        left = np.delete(left, first)
    parts.append(minimise(residual, box, settings, rng, start=best))
    return _in_one(parts, parts[-1].best)


def stepwise_singular(
    residual: Residual,
    jacobian: Array,
    box: Box,
    settings: SwarmSettings,
    rng: np.random.Generator,
) -> SwarmResult:
    """Search along each singular direction of the identification Jacobian, strongest first.

    A direction is searched over the width that the box has along it. Directions with a zero
    singular value are left out: these combinations stay at the middle of the box.

    Args:
        residual: parameters (n, p) to norms (n,).
        jacobian: d(residual)/d(parameters), (rows, p).
        box: p intervals.
        settings: of each direction's search.
        rng: source of all chance.

    Raises:
        DataError: as `minimise`.
    """
    best, parts = box.middle, []
    for direction in _directions(jacobian, box):
        along = box.half_width * direction
        reach = Box.about_zero(np.array([np.abs(direction).sum()]))
        part = minimise(_along(residual, best, along), reach, settings, rng)
        parts.append(part)
        best = best + part.best[0] * along
    return _in_one(parts, best)


def all_singular(
    residual: Residual,
    jacobian: Array,
    box: Box,
    settings: SwarmSettings,
    rng: np.random.Generator,
) -> SwarmResult:
    """As `stepwise_singular`, but search all singular coordinates together.

    Raises:
        DataError: as `minimise`.
    """
    turned = _directions(jacobian, box)
    reach = Box.about_zero(np.abs(turned).sum(axis=1))
    along = turned * box.half_width
    found = minimise(lambda c: residual(box.middle + c @ along), reach, settings, rng)
    return replace(found, best=box.middle + found.best @ along)


def _among(residual: Residual, place: Array, rows: NDArray[np.intp]) -> Residual:
    """The residual as a function of some parameters, with the others held at `place`."""

    def of_some(values: Array) -> Array:
        whole = np.tile(place, (len(values), 1))
        whole[:, rows] = values
        return residual(whole)

    return of_some


def _directions(jacobian: Array, box: Box) -> Array:
    """Singular vectors in units of the box's half widths, strongest first, (r, p)."""
    values, turned = np.linalg.svd(jacobian * box.half_width, full_matrices=False)[1:]
    return np.asarray(turned[values > _NONE * values[0]])


def _along(residual: Residual, place: Array, direction: Array) -> Residual:
    """The residual along a line, as a function of (n, 1) steps."""
    return lambda c: residual(place + c * direction)


def _some(box: Box, rows: NDArray[np.intp]) -> Box:
    return Box(box.lower[rows], box.upper[rows])


def _in_one(parts: list[SwarmResult], best: Array) -> SwarmResult:
    history = np.minimum.accumulate(np.concatenate([part.history for part in parts]))
    return SwarmResult(best, parts[-1].norm, sum(part.evaluations for part in parts), history)
