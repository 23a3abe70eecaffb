"""All laws of a grammar about one fit: how well each explains what is left, and at what price.

The column of a law's value is what it moves times a function of the sample,

    x = m f        m (n, d): whitened d(reading) / d(what is moved),    f (n,): the function

A law of all joints and those of each alone have columns in common: their products under V
(`linear_model.py`) are worked out once. Where a shape is searched m stays, and with it what each
sample gives to a product with anything that stays as well,

    x' y = sum f (m . y)

so that another shape costs as much as its function.

A law is charged as a cause of the catalogue is (`scores.py`): its values share one size.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.columns import Plain, joined
from delta_calibration.diagnosis.constants import TYPICAL_SHIFT
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import PRECISION, log_bayes_of_each
from delta_calibration.effects.base import Stage
from delta_calibration.effects.found_law import FoundLaw, Taken, function_of
from delta_calibration.effects.signals import Signals

Array = NDArray[np.float64]

_AT_A_TIME = 64  # columns in memory together
_NO_COLUMN = 1e-12  # of a displacement, under which it is none

Moved = tuple[Stage, tuple[tuple[int, float], ...]]  # what is moved, and how much of each
Column = tuple[Moved, Taken]


@dataclass(frozen=True)
class Case:
    """How well some columns explain what is left."""

    log_bayes: float
    gain: float  # decrease of chi square
    value: Array  # (k,) most likely, in `size`
    size: Array  # (k,) units in which each column moves the reading by `TYPICAL_SHIFT`
    information: Array  # (k, k) in those units


class _Products(NamedTuple):
    """Of as many columns in each of L sets."""

    information: Array  # (L, k, k)
    b: Array  # (L, k) along what is left
    square: Array  # (L, k) squared length

    def of(self, i: int, rows: Sequence[int]) -> _Products:
        """Some of the columns of one set, a set of their own."""
        own = self.information[i][np.ix_(rows, rows)]
        return _Products(own[None], self.b[i, rows][None], self.square[i, rows][None])


@dataclass(frozen=True)
class Screen:
    """Products of the columns of laws about one evidence.

    Args:
        evidence: of what is left, with all that may always be in its nuisance.
        signals: of its samples.
    """

    evidence: LinearizedModel
    signals: Signals

    def cases(self, laws: Sequence[FoundLaw]) -> list[Case]:
        """Each law's case by itself; those of one shape follow each other."""
        pairs = [tuple(self.pairs(law)) for law in laws]
        known: dict[int, _Products] = {}
        for sets in _batches(laws, pairs):
            every = [list(dict.fromkeys(pair for i in own for pair in pairs[i])) for own in sets]
            found = self._products(every)
            for at, (own, columns) in enumerate(zip(sets, every, strict=True)):
                place = {column: row for row, column in enumerate(columns)}
                known.update((i, found.of(at, [place[p] for p in pairs[i]])) for i in own)
        return self._each(known)

    def case(self, laws: Sequence[FoundLaw]) -> Case:
        """That of some laws together."""
        return self.judged(self._products([self._pairs(laws)]))[0]

    def signal(self, laws: Sequence[FoundLaw], case: Case) -> Array:
        """What they make of the whitened readings at their most likely values, (d n,)."""
        return np.asarray(self.columns(laws) @ (case.value * case.size))

    def columns(self, laws: Sequence[FoundLaw]) -> Array:
        """Those of some laws, (d n, k)."""
        return self._columns(self._pairs(laws))

    def pairs(self, law: FoundLaw) -> Iterator[Column]:
        """What each value moves, and its function."""
        for target in law.targets:
            for kind in law.kinds:
                taken = law.factor(self.signals.places, target, kind)
                yield (law.stage, target.rows), taken

    def judged(self, products: _Products) -> list[Case]:
        """Cases of sets of as many columns each, (L,)."""
        direct, b, square = products
        metres = self._noise * np.sqrt(square / self._count)
        size = TYPICAL_SHIFT / np.maximum(metres, _NO_COLUMN)
        information, b = size[:, :, None] * direct * size[:, None], size * b
        normal = information + PRECISION * np.eye(size.shape[1])
        value = np.asarray(np.linalg.solve(normal, b[..., None])[..., 0], dtype=float)
        worth = log_bayes_of_each(information, b, value).tolist()
        gain = np.sum(value * (2 * b - (information @ value[..., None])[..., 0]), axis=1)
        return list(map(Case, worth, np.maximum(0.0, gain).tolist(), value, size, information))

    def function(self, taken: Taken) -> Array:
        """A function at all samples, (n,)."""
        return function_of(taken, self._rows)

    def moved(self, moved: Moved) -> Array:
        """How whitened readings go with what is moved, (n, d)."""
        stage, rows = moved
        slope = self.evidence.by_stage(stage)
        return np.asarray(sum(weight * slope[:, :, row] for row, weight in rows))

    @cached_property
    def weighed(self) -> Array:
        """V^-1 of what is left, (d n, 1)."""
        return self.evidence.weigh(self.evidence.column)

    def _pairs(self, laws: Sequence[FoundLaw]) -> list[Column]:
        return [pair for law in laws for pair in self.pairs(law)]

    def _each(self, known: dict[int, _Products]) -> list[Case]:
        """The cases of all laws, in their order."""
        found: dict[int, Case] = {}
        alike: dict[int, list[int]] = {}
        for i, products in known.items():
            alike.setdefault(products.b.shape[1], []).append(i)
        for own in alike.values():
            together = (
                np.concatenate(part) for part in zip(*(known[i] for i in own), strict=True)
            )
            found.update(zip(own, self.judged(_Products(*together)), strict=True))
        return [found[i] for i in range(len(found))]

    def _products(self, sets: Sequence[Sequence[Column]]) -> _Products:
        """Of sets of as many columns each."""
        count, k = len(sets), len(sets[0])
        columns = self._columns([column for own in sets for column in own])
        return _Products(
            self.evidence.information_of_each(columns, k),
            (columns.T @ self.weighed).reshape(count, k),
            np.einsum("nk,nk->k", columns, columns).reshape(count, k),
        )

    def _columns(self, columns: Sequence[Column]) -> Array:
        """Columns multiplied out, (d n, k)."""
        found = np.empty((len(columns), *self.evidence.residual.shape))
        moved = {key: self.moved(key) for key in dict.fromkeys(own for own, _ in columns)}
        functions = {key: self.function(key) for key in dict.fromkeys(own for _, own in columns)}
        for into, (what, taken) in zip(found, columns, strict=True):
            np.multiply(moved[what], functions[taken][:, None], out=into)
        return found.reshape(len(columns), self.evidence.size).T

    @cached_property
    def _rows(self) -> Array:
        """The signals, one after the other, (S, n)."""
        return np.ascontiguousarray(self.signals.rows.T)

    @cached_property
    def _noise(self) -> float:
        """Of a coordinate [m]."""
        evidence = self.evidence
        variance = np.nanmean(evidence.variance[evidence.believed])
        return float(np.sqrt(variance / evidence.axes))

    @cached_property
    def _count(self) -> int:
        return int(self.evidence.believed.sum())


@dataclass(frozen=True)
class Reshaped:
    """One of some laws in any shape, the others beside it as they are.

    Args:
        screen: of the evidence.
        laws: all of them.
        number: of the one whose shape changes; what it moves does not.
    """

    screen: Screen
    laws: tuple[FoundLaw, ...]
    number: int

    def case(self, law: FoundLaw) -> Case:
        """That of all together, with the one in this shape."""
        pairs, evidence = list(self.screen.pairs(law)), self.screen.evidence
        functions = [self.screen.function(taken) for _, taken in pairs]
        given = [self._given[moved] for moved, _ in pairs]
        columns = [(own.m * f[:, None]).ravel() for own, f in zip(given, functions, strict=True)]
        flat = np.stack(columns)
        along = np.stack([f @ g.along for g, f in zip(given, functions, strict=True)], axis=1)
        shared = np.stack([g.shared_of(f) for g, f in zip(given, functions, strict=True)], axis=1)
        size, inner = len(evidence.precision), flat @ flat.T
        own = evidence.left_of(inner, along[:size], shared)
        across, others = along[size + 1 :], self._others
        whole = np.block([[others.information[0], across], [across.T, own]])
        b = np.concatenate([others.b[0], along[size]])
        square = np.concatenate([others.square[0], np.diag(inner)])
        order = self._order(len(pairs))
        found = _Products(whole[np.ix_(order, order)][None], b[order][None], square[order][None])
        return self.screen.judged(found)[0]

    def _order(self, own: int) -> NDArray[np.intp]:
        """Columns of all laws where those of the one stand behind the others'."""
        before = sum(1 for law in self.laws[: self.number] for _ in self.screen.pairs(law))
        others = len(self._others.b[0])
        return np.asarray(np.r_[:before, others : others + own, before:others])

    @cached_property
    def _columns(self) -> Array:
        """Of the others, (d n, k)."""
        screen, laws, i = self.screen, self.laws, self.number
        return screen.columns((*laws[:i], *laws[i + 1 :]))

    @cached_property
    def _weighed(self) -> Array:
        """V^-1 of them, (d n, k)."""
        return self.screen.evidence.weigh(self._columns)

    @cached_property
    def _others(self) -> _Products:
        columns = self._columns
        return _Products(
            (columns.T @ self._weighed)[None],
            (columns.T @ self.screen.weighed)[:, 0][None],
            np.einsum("nk,nk->k", columns, columns)[None],
        )

    @cached_property
    def _given(self) -> dict[Moved, _Given]:
        """By what the law moves."""
        screen, evidence = self.screen, self.screen.evidence
        fixed = joined([evidence.possible, Plain(screen.weighed), Plain(self._weighed)])
        found = {}
        for moved, _ in screen.pairs(self.laws[self.number]):
            if moved not in found:
                m = screen.moved(moved)
                shared = evidence.rest.seen_by_sample(m)
                found[moved] = _Given(m, fixed.through(m), shared, evidence.rest.samples)
        return found


@dataclass(frozen=True)
class _Given:
    """What each sample gives to the products of m f with what stays, whatever f is."""

    m: Array  # (n, d)
    along: Array  # (n, A + 1 + k): nuisance, what is left, other columns
    shared: tuple[Array, ...]  # (samples, r) of each part of what looks like rest errors
    samples: tuple[slice, ...]  # of these

    def shared_of(self, f: Array) -> Array:
        """What of m f looks like rest errors, (r,)."""
        parts = [f[rows] @ own for rows, own in zip(self.samples, self.shared, strict=True)]
        return np.concatenate([np.zeros(0), *parts])


def _batches(
    laws: Sequence[FoundLaw], pairs: Sequence[Sequence[Column]]
) -> Iterator[list[list[int]]]:
    """Laws of one shape each, with as many columns together, some at a time."""
    alike: dict[int, list[list[int]]] = {}
    for _, rows in groupby(range(len(laws)), lambda i: _shape(laws[i])):
        own = list(rows)
        count = len({pair for i in own for pair in pairs[i]})
        alike.setdefault(count, []).append(own)
    for count, sets in alike.items():
        step = max(1, _AT_A_TIME // count)
        for begin in range(0, len(sets), step):
            yield sets[begin : begin + step]


def _shape(law: FoundLaw) -> Hashable:
    """What a law is, but for what it moves."""
    return law.stage, law.of, law.function, law.by, law.middle, law.scale, law.bearing
