"""Commands that come back: what was sent to the drives is commanded again, its mark lost."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque

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
    """

    def __init__(self) -> None:
        self._order: deque[tuple[float, int]] = deque()
        self._first: list[tuple[float, int]] = []  # the first joint of each and its number, sorted
        self._sent: dict[int, tuple[Array, Array]] = {}  # output and correction, by number
        self._number = 0

    def sent(self, output: Array, correction: Array) -> None:
        """Remember an output (m,) [rad] and the correction in it, if there is one."""
        if max(map(abs, correction.tolist())) <= _LEAST:
            return
        key = float(output[0]), self._number
        self._number += 1
        self._sent[key[1]] = output, correction
        self._order.append(key)
        insort(self._first, key)
        if len(self._order) > _KEPT:
            oldest = self._order.popleft()
            del self._sent[oldest[1]], self._first[bisect_left(self._first, oldest)]

    def of(self, q: Array) -> Array | None:
        """The correction (m,) [rad] that a command carries already; None if it carries none."""
        first = float(q[0])
        for row in range(bisect_left(self._first, (first - _SAME, -1)), len(self._first)):
            angle, number = self._first[row]
            if angle > first + _SAME:  # nearly always the first that is looked at
                break
            output, correction = self._sent[number]
            if (np.abs(output - q) <= _SAME).all():
                return correction
        return None
