"""Find causes that more machines of a fleet share than chance explains.

Every machine was examined for the same causes at the same locations. With n machines, k_j of them
have cause j. Each count is compared with the rates of all other causes: a beta distribution with
the mean and spread of these rates (method of moments), so that the count by chance is
beta-binomial. The spread is taken as `_WIDER` times the observed one, because it is estimated from
a few dozen counts only, and rates of causes have longer tails than a beta distribution. The p
value is the probability of as many or more, times the number of tests (Bonferroni): below `SURE` a
cause is shared, below `PERHAPS` it may be. The same test is made with locations (which joint) as
part of the cause, and for changes. If the machines that share a cause also have the same searched
order, as with a bad batch of gears, the order is reported.
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

SURE = 1e-3  # p value below which a cause is reported as shared
PERHAPS = 0.05  # p value below which it is reported as perhaps shared
_LEAST = 3  # least number of machines that share a cause
_MOST = 0.8  # share of machines above which it counts as nearly all
_WIDER = 3.0  # factor on the spread of the other causes' rates
_ORDER = "order"  # entry of a shape: periods per turn, or per metre of joints that slide
_PER_METRE = "1/m"


@dataclass(frozen=True)
class Shared:
    """A cause that several machines have."""

    what: str  # in words
    machines: tuple[str, ...]
    of: int  # machines that were examined
    expected: float  # number of machines expected by chance
    p_value: float

    @property
    def sure(self) -> bool:
        """Whether it is reported as shared; otherwise as perhaps shared."""
        return self.p_value < SURE


@dataclass(frozen=True)
class _Kind:
    """One kind of sign, such as causes at locations, with those that each machine has."""

    signs: Mapping[str, frozenset[str]]  # of each machine
    possible: int  # number of different signs that a machine could have


def shared_causes(fleet: Sequence[Standing], causes: int, places: int) -> tuple[Shared, ...]:
    """List causes and changes that more machines share than chance explains, least p value first.

    Args:
        fleet: standing of each machine.
        causes: number of causes that a diagnosis searches for.
        places: number of locations (joints) that a cause can have.
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
    """Count of one cause expected from the other causes, and the probability of as many or more.

    Args:
        counts: number of machines that have each cause, (c,).
        number: index of the cause.
        machines: number of machines that were examined.
    """
    others = np.delete(counts, number)
    rate = (others.sum() + 0.5) / (machines * len(others) + 1.0)
    spread = float(np.var(others / machines))
    binomial = rate * (1 - rate) / machines
    # correlation of two machines in the same cause, from the variance of rates beyond binomial
    alike = _WIDER * (spread - binomial) / (rate * (1 - rate))
    alike = float(np.clip(alike, 1.0 / (machines * len(others)), 0.5))
    size = (1 - alike) / alike
    as_many = np.arange(counts[number], machines + 1)
    tail = np.exp(_log_beta_binomial(as_many, machines, rate * size, (1 - rate) * size)).sum()
    return float(rate * machines), float(min(tail, 1.0))


def _log_beta_binomial(k: Array, n: int, a: float, b: float) -> Array:
    """Log probability of k of n if their common probability is drawn from Beta(a, b)."""
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
    """Drop entries if nearly all their machines are those of an entry with a lower p value."""
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


def _orders(each: Standing) -> frozenset[str]:
    """Orders of a machine's causes, rounded to two digits so that equal parts compare equal."""
    orders = ((one.get("shape", {}).get(_ORDER), one) for one in each.findings)
    return frozenset(_order(order, one) for order, one in orders if order is not None)


def _order(order: float, finding: Mapping[str, Any]) -> str:
    """An order in words, per metre where joints slide."""
    per = " per m" if finding.get("shape_unit", {}).get(_ORDER) == _PER_METRE else ""
    return f"{float(f'{order:.2g}'):g}{per}"


def _with_order(each: Shared, orders: Mapping[str, frozenset[str]]) -> Shared:
    """Add the order to the name of a cause if nearly all its machines have the same one."""
    counted = Counter(order for machine in each.machines for order in orders[machine])
    for order, count in counted.most_common(1):
        if count > _MOST * len(each.machines):
            return replace(each, what=f"{each.what} of order {order}")
    return each
