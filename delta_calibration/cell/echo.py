"""Commands that come back: what was sent to the drives is commanded again, its mark lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_KEPT = 256  # outputs: a quarter of a second at 1 kHz, longer than a loop through a controller
_SAME = 1e-9  # [rad] a command this near an output is that output
_LEAST = 1e-7  # [rad] a correction below this does no harm twice


class Echo:
    """The last outputs, each with the correction in it.

    A command of the motion's own meets one of them to `_SAME` in every joint by an accident that
    a smooth motion does not have.

    Args:
        joints: how many there are.
    """

    def __init__(self, joints: int) -> None:
        self._sent = np.full((_KEPT, joints), np.inf)
        self._first = np.full(_KEPT, np.inf)  # the first joint of each, in one place
        self._correction = np.zeros((_KEPT, joints))
        self._next = 0

    def sent(self, output: Array, correction: Array) -> None:
        """Remember an output (m,) [rad] and the correction in it, if there is one."""
        if np.abs(correction).max() > _LEAST:
            self._sent[self._next], self._correction[self._next] = output, correction
            self._first[self._next] = output[0]
            self._next = (self._next + 1) % _KEPT

    def of(self, q: Array) -> Array | None:
        """The correction (m,) [rad] that a command carries already; None if it carries none."""
        near = np.flatnonzero(np.abs(self._first - q[0]) <= _SAME)  # nearly always none
        for row in near.tolist():
            if (np.abs(self._sent[row] - q) <= _SAME).all():
                return np.array(self._correction[row])
        return None
