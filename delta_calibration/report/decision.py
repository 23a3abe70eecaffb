"""Pass or fail by a decision rule: ISO 14253-1, the uncertainty counts against whoever claims.

A point passes where error + U <= tolerance, fails where error - U > tolerance, and between the two
nothing is decided.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Decision(Enum):
    """What a measurement says of a tolerance."""

    PASS = "pass"
    FAIL = "fail"
    NOT_DECIDED = "not decided"


def decided(error: Array, expanded: Array, tolerance: float) -> tuple[Decision, ...]:
    """Of each point.

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


def of_all(points: Sequence[Decision], whole: bool) -> Decision:
    """Of a machine: it passes where every point does, and none was set aside.

    Args:
        points: of those that were judged.
        whole: whether all that was measured was judged.
    """
    if Decision.FAIL in points:
        return Decision.FAIL
    if not whole or Decision.NOT_DECIDED in points:
        return Decision.NOT_DECIDED
    return Decision.PASS
