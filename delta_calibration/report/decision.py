"""Decision rule of ISO 14253-1: the uncertainty counts against the party that makes the claim.

A point passes if error + U <= tolerance and fails if error - U > tolerance; between the two it is
not decided.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Decision(Enum):
    """Result of the comparison of a measured error with a tolerance."""

    PASS = "pass"
    FAIL = "fail"
    NOT_DECIDED = "not decided"


def decided(error: Array, expanded: Array, tolerance: float) -> tuple[Decision, ...]:
    """Decide each point.

    Args:
        error: 3-D distances, (n,) [m].
        expanded: their expanded uncertainties U, (n,) [m].
        tolerance: largest error allowed [m].
    """
    return tuple(
        Decision.PASS
        if e + u <= tolerance
        else Decision.FAIL
        if e - u > tolerance
        else Decision.NOT_DECIDED
        for e, u in zip(error, expanded, strict=True)
    )


def of_all(points: Sequence[Decision]) -> Decision:
    """Decide a machine: it passes if every point does, and fails if one fails."""
    if Decision.FAIL in points:
        return Decision.FAIL
    return Decision.NOT_DECIDED if Decision.NOT_DECIDED in points else Decision.PASS
