"""Rates with exact intervals, and the calibration of stated probabilities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

_EDGES = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0)


@dataclass(frozen=True)
class Rate:
    """Rate: the number of cases in which something held, and the number of cases."""

    held: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper-Pearson interval, 95 %."""
        if self.of == 0:
            return 0.0, 1.0
        found = binomtest(self.held, self.of).proportion_ci(0.95, method="exact")
        return float(found.low), float(found.high)

    def __str__(self) -> str:
        """Percent, interval, n."""
        if self.of == 0:
            return "n = 0"
        low, high = self.interval
        return f"{self.held / self.of:.1%} ({low:.1%} to {high:.1%}, n = {self.of})"


def reliability(
    stated: Sequence[float], right: Sequence[bool]
) -> Iterator[tuple[float, float, float, Rate]]:
    """Yield ranges of stated probability: ends, the mean stated, and the rate of right ones."""
    probability, held = np.array(stated, dtype=float), np.array(right, dtype=bool)
    which = np.clip(np.searchsorted(_EDGES, probability, side="right") - 1, 0, len(_EDGES) - 2)
    for number in np.unique(which):
        own = which == number
        rate = Rate(int(held[own].sum()), int(own.sum()))
        yield _EDGES[number], _EDGES[number + 1], float(probability[own].mean()), rate


def calibration_error(stated: Sequence[float], right: Sequence[bool]) -> float:
    """Mean distance of stated probability and rate over the ranges, weighted by their numbers."""
    rows = list(reliability(stated, right))
    total = sum(rate.of for *_, rate in rows)
    off = sum(abs(mean - rate.held / rate.of) * rate.of for *_, mean, rate in rows)
    return off / max(total, 1)
