"""Causes of a fleet's machines that more of them have than chance explains.

Every machine has been looked at for the same causes, at the same places. With n machines and
counts k_j of those that have the j-th, a count is held against what all the others say of how
often one is found: their rate with its spread, a beta distribution by its moments, so that a
count by chance is beta-binomial. The spread is taken as `_WIDER` times what the others show: it
is known from a few dozen counts only, and rates of causes have longer tails than a beta
distribution. The chance of as many or more, times the number of causes looked at (Bonferroni), is
the p value: under `SURE` a cause is shared, under `PERHAPS` it may be. The same is done with
places (which joint) taken as part of the cause. Where those that share a cause have the same
searched order as well, as a bad batch of gears has, that is told.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln  # scipy.stats takes long to import

from delta_calibration.fleet.standing import Standing
from delta_calibration.wording import spoken

Array = NDArray[np.float64]

SURE = 1e-3  # p value under which a cause is told as shared
PERHAPS = 0.05  # p value under which it is told as perhaps shared
_LEAST = 3  # machines that share one
_MOST = 0.8  # share of machines that is nearly all of them
_WIDER = 3.0  # times the spread of the other causes' rates
_ORDER = "order"  # of a shape: periods a turn


@dataclass(frozen=True)
class Shared:
    """A cause that several machines have."""

    what: str  # in words
    machines: tuple[str, ...]
    of: int  # machines that were looked at
    expected: float  # how many by chance
    p_value: float

    @property
    def sure(self) -> bool:
        """Whether it is told as shared; else it perhaps is."""
        return self.p_value < SURE


@dataclass(frozen=True)
class _Kind:
    """What is taken for the same: signs of the machines, and how many such there could be."""

    signs: Mapping[str, frozenset[str]]  # of each machine
    possible: int


def shared_causes(fleet: Sequence[Standing], causes: int, places: int) -> tuple[Shared, ...]:
    """Causes, and changes, that more machines have than chance may explain, surest first.

    Args:
        fleet: how each machine stands.
        causes: how many causes a diagnosis looks for.
        places: at how many places (joints) a cause can be.
    """
    kinds = [
        _kind(fleet, "findings", _cause, causes),
        _kind(fleet, "findings", _cause_and_place, causes * places),
        _kind(fleet, "changes", _cause, causes),
        _kind(fleet, "changes", _cause_and_place, causes * places),
    ]
    words = ("", "", "a change of ", "a change of ")
    tried = sum(kind.possible for kind in kinds)
    found = [
        each
        for kind, word in zip(kinds, words, strict=True)
        for each in _of_kind(kind, len(fleet), tried, word)
    ]
    orders = {each.machine: _orders(each) for each in fleet}
    told = _plainest(sorted(found, key=lambda each: each.p_value))
    return tuple(_with_order(each, orders) for each in told)


def chance_of(counts: Array, number: int, machines: int) -> tuple[float, float]:
    """Expected count of one cause, and the chance of as many as it has, by the other causes.

    Args:
        counts: of machines that have each cause, (c,).
        number: which of them.
        machines: how many were looked at.
    """
    others = np.delete(counts, number)
    rate = (others.sum() + 0.5) / (machines * len(others) + 1.0)
    spread = float(np.var(others / machines))
    binomial = rate * (1 - rate) / machines
    # correlation of two machines in the same cause: what the counts vary by more than chance
    alike = _WIDER * (spread - binomial) / (rate * (1 - rate))
    alike = float(np.clip(alike, 1.0 / (machines * len(others)), 0.5))
    size = (1 - alike) / alike
    as_many = np.arange(counts[number], machines + 1)
    tail = np.exp(_log_beta_binomial(as_many, machines, rate * size, (1 - rate) * size)).sum()
    return float(rate * machines), float(min(tail, 1.0))


def _log_beta_binomial(k: Array, n: int, a: float, b: float) -> Array:
    """ln of the probability of k of n, each as likely as a draw of Beta(a, b) says."""
    ways = -np.log(n + 1) - betaln(n - k + 1, k + 1)
    return np.asarray(ways + betaln(k + a, n - k + b) - betaln(a, b))


def _of_kind(kind: _Kind, machines: int, tried: int, word: str) -> list[Shared]:
    counted = Counter(sign for signs in kind.signs.values() for sign in signs)
    possible = max(kind.possible, len(counted) + 1)
    counts = np.zeros(possible)
    counts[: len(counted)] = list(counted.values())
    found = []
    for number, (sign, count) in enumerate(counted.items()):
        if count < _LEAST:
            continue
        expected, p = chance_of(counts, number, machines)
        p = min(1.0, p * tried)
        if p < PERHAPS:
            having = tuple(name for name, signs in kind.signs.items() if sign in signs)
            found.append(Shared(word + sign, having, machines, expected, p))
    return found


def _plainest(found: Sequence[Shared]) -> tuple[Shared, ...]:
    """Without those whose machines another one has already, nearly all of them."""
    kept: list[Shared] = []
    for each in found:
        own = set(each.machines)
        if not any(len(own & set(k.machines)) > _MOST * len(own) for k in kept):
            kept.append(each)
    return tuple(kept)


def _kind(fleet: Sequence[Standing], what: str, sign: Any, possible: int) -> _Kind:
    signs = {
        each.machine: frozenset(filter(None, (sign(one) for one in getattr(each, what))))
        for each in fleet
    }
    return _Kind(signs, possible)


def _cause(one: Mapping[str, Any]) -> str:
    return spoken(one.get("cause") or one["what"])


def _cause_and_place(one: Mapping[str, Any]) -> str:
    return f"{_cause(one)} at {spoken(one['location'])}" if one["location"] else ""


def _orders(each: Standing) -> frozenset[float]:
    """Orders of a machine's causes, to two figures: the same parts have the same."""
    orders = (one.get("shape", {}).get(_ORDER) for one in each.findings)
    return frozenset(float(f"{order:.2g}") for order in orders if order is not None)


def _with_order(each: Shared, orders: Mapping[str, frozenset[float]]) -> Shared:
    """The same with the order that most of its machines have."""
    counted = Counter(order for machine in each.machines for order in orders[machine])
    for order, count in counted.most_common(1):
        if count > _MOST * len(each.machines):
            return replace(each, what=f"{each.what} of order {order:g}")
    return each
