"""Commands that come back: what was sent to the drives is commanded again, its mark lost."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell.ramp import Stage

Array = NDArray[np.float64]

_KEPT = 256  # outputs: a quarter of a second at 1 kHz, longer than a loop through a controller
_SAME = 1e-9  # [rad] a command this near an output is that output
_LEAST = 1e-7  # [rad] a correction below this does no harm twice


@dataclass(frozen=True)
class Output:
    """What was sent to the drives."""

    joint: Array  # (m,) [rad]
    stage: Stage  # of the correction in it
    astray: bool  # on its way back from a hold: no command's own place

    def is_at(self, q: Array) -> bool:
        """Whether a command (m,) [rad] is this output."""
        return bool((np.abs(self.joint - q) <= _SAME).all())

    @cached_property
    def odd(self) -> bool:
        """Whether it is no command as any other, without its mark as well."""
        return self.astray or bool(np.abs(self.stage.applied).max() > _LEAST)


class Echo:
    """The last outputs that are more than their commands.

    A command of the motion's own meets one of them to `_SAME` in every joint by an accident that
    a smooth motion does not have.
    """

    def __init__(self) -> None:
        self._order: deque[tuple[float, int]] = deque()
        self._first: list[tuple[float, int]] = []  # the first joint of each and its number, sorted
        self._sent: dict[int, Output] = {}  # by number
        self._number = 0

    def sent(self, output: Output) -> None:
        """Remember an output."""
        key = float(output.joint[0]), self._number
        self._number += 1
        self._sent[key[1]] = output
        self._order.append(key)
        insort(self._first, key)
        if len(self._order) > _KEPT:
            oldest = self._order.popleft()
            del self._sent[oldest[1]], self._first[bisect_left(self._first, oldest)]

    def of(self, q: Array, marked: bool) -> Output | None:
        """The newest output that a command (m,) [rad] is; None if it is none.

        A marked one may have no correction in it yet, one that has lost its mark has.
        """
        first, newest = float(q[0]), -1
        for row in range(bisect_left(self._first, (first - _SAME, -1)), len(self._first)):
            angle, number = self._first[row]
            if angle > first + _SAME:  # nearly always the first that is looked at
                break
            output = self._sent[number]
            if number > newest and (marked or output.odd) and output.is_at(q):
                newest = number
        return self._sent.get(newest)
