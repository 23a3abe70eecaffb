"""Screening of all laws of a grammar about one fit: the Bayes factor of each on the residuals.

The column of a law's value is the derivative by its target times a function of the sample,

    x = m f        m (n, d): whitened d(reading) / d(target),    f (n,): the function

A law of all joints and the laws of single joints have columns in common: their products under V
(`linear_model.py`) are computed once. While a shape is searched m does not change. In a product
with columns y that do not change either,

    x' y = sum f (m . y)

the dot products m . y of the samples are therefore computed once, and another shape costs only
its function.

A law pays for its values as a cause of the catalogue does (`scores.py`): they share one size.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
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
from delta_calibration.lazy import cached_property
from delta_calibration.threads import mapped

Array = NDArray[np.float64]

_AT_A_TIME = 64  # columns in memory together
_NO_COLUMN = 1e-12  # [m] displacement under which a column counts as zero

Moved = tuple[Stage, tuple[tuple[int, float], ...]]  # numbers of a stage, and weight of each
Column = tuple[Moved, Taken]


@dataclass(frozen=True)
class Case:
    """How well some columns explain the residuals."""

    log_bayes: float
    gain: float  # decrease of chi square
    value: Array  # (k,) most likely, in `size`
    size: Array  # (k,) units in which each column moves the reading by `TYPICAL_SHIFT`
    information: Array  # (k, k) in those units


class _Products(NamedTuple):
    """Inner products of the columns of L sets, each of k columns."""

    information: Array  # (L, k, k)
    b: Array  # (L, k) products with the residuals
    square: Array  # (L, k) squared length

    def of(self, i: int, rows: Sequence[int]) -> _Products:
        """Products of some of the columns of set `i`, as a single set."""
        own = self.information[i][np.ix_(rows, rows)]
        return _Products(own[None], self.b[i, rows][None], self.square[i, rows][None])


@dataclass(frozen=True)
class Screen:
    """Scores of laws by the products of their columns about one evidence.

    Args:
        evidence: the residuals to explain, with all causes already found in its nuisance.
        signals: of its samples.
    """

    evidence: LinearizedModel
    signals: Signals

    def cases(self, laws: Sequence[FoundLaw]) -> list[Case]:
        """The case of each law alone; laws of one shape share columns if they are adjacent."""
        pairs = [tuple(self.pairs(law)) for law in laws]
        known: dict[int, _Products] = {}
        for found in mapped(partial(self._of_sets, pairs), _batches(laws, pairs)):
            known.update(found)
        return self._each(known)

    def _of_sets(
        self, pairs: Sequence[Sequence[Column]], sets: Sequence[Sequence[int]]
    ) -> dict[int, _Products]:
        """Products of each law of some sets, by its number; the laws of a set share columns."""
        every = [list(dict.fromkeys(pair for i in own for pair in pairs[i])) for own in sets]
        found, known = self._products(every), dict[int, _Products]()
        for at, (own, columns) in enumerate(zip(sets, every, strict=True)):
            place = {column: row for row, column in enumerate(columns)}
            known.update((i, found.of(at, [place[p] for p in pairs[i]])) for i in own)
        return known

    def case(self, laws: Sequence[FoundLaw]) -> Case:
        """The case of several laws together."""
        return self.judged(self._products([self._pairs(laws)]))[0]

    def signal(self, laws: Sequence[FoundLaw], case: Case) -> Array:
        """Whitened displacement of the readings by laws at their most likely values, (d n,)."""
        return np.asarray(self.columns(laws) @ (case.value * case.size))

    def columns(self, laws: Sequence[FoundLaw]) -> Array:
        """Whitened columns of several laws, (d n, k)."""
        return self._columns(self._pairs(laws))

    def pairs(self, law: FoundLaw) -> Iterator[Column]:
        """For each value of a law: the numbers of the stage that it moves, and its function."""
        for target in law.targets:
            for kind in law.kinds:
                taken = law.factor(self.signals.places, target, kind)
                yield (law.stage, target.rows), taken

    def judged(self, products: _Products) -> list[Case]:
        """Cases of L sets of columns from their products."""
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
        """Derivative of the whitened readings by the weighted numbers of a stage, (n, d)."""
        stage, rows = moved
        slope = self.evidence.by_stage(stage)
        return np.asarray(sum(weight * slope[:, :, row] for row, weight in rows))

    @cached_property
    def weighed(self) -> Array:
        """V^-1 r of the residuals r, (d n, 1)."""
        return self.evidence.weigh(self.evidence.column)

    def _pairs(self, laws: Sequence[FoundLaw]) -> list[Column]:
        return [pair for law in laws for pair in self.pairs(law)]

    def _each(self, known: dict[int, _Products]) -> list[Case]:
        """Cases of all laws in their order, from their products by the law's number."""
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
        """Inner products of sets that all have the same number of columns."""
        count, k = len(sets), len(sets[0])
        columns = self._columns([column for own in sets for column in own])
        return _Products(
            self.evidence.information_of_each(columns, k),
            (columns.T @ self.weighed).reshape(count, k),
            np.einsum("nk,nk->k", columns, columns).reshape(count, k),
        )

    def _columns(self, columns: Sequence[Column]) -> Array:
        """Columns m f multiplied out, (d n, k)."""
        found = np.empty((len(columns), *self.evidence.residual.shape))
        moved = {key: self.moved(key) for key in dict.fromkeys(own for own, _ in columns)}
        functions = {key: self.function(key) for key in dict.fromkeys(own for _, own in columns)}
        for into, (what, taken) in zip(found, columns, strict=True):
            np.multiply(moved[what], functions[taken][:, None], out=into)
        return found.reshape(len(columns), self.evidence.size).T

    @cached_property
    def _rows(self) -> Array:
        """The signals as rows, each contiguous in memory, (S, n)."""
        return np.ascontiguousarray(self.signals.rows.T)

    @cached_property
    def _noise(self) -> float:
        """Root mean square noise of one coordinate [m]."""
        evidence = self.evidence
        variance = np.nanmean(evidence.variance[evidence.believed])
        return float(np.sqrt(variance / evidence.axes))

    @cached_property
    def _count(self) -> int:
        return int(self.evidence.believed.sum())


@dataclass(frozen=True)
class Reshaped:
    """Several laws, of which one can be given any shape while the others keep theirs.

    Args:
        screen: of the evidence.
        laws: all of them.
        number: index of the law whose shape changes; its targets do not.
    """

    screen: Screen
    laws: tuple[FoundLaw, ...]
    number: int

    def case(self, law: FoundLaw) -> Case:
        """The case of all laws together, with the changing law in this shape."""
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
        """Indices that move the changing law's columns from the end to their place, (k,)."""
        before = sum(1 for law in self.laws[: self.number] for _ in self.screen.pairs(law))
        others = len(self._others.b[0])
        return np.asarray(np.r_[:before, others : others + own, before:others])

    @cached_property
    def _columns(self) -> Array:
        """Columns of the other laws, (d n, k)."""
        screen, laws, i = self.screen, self.laws, self.number
        return screen.columns((*laws[:i], *laws[i + 1 :]))

    @cached_property
    def _weighed(self) -> Array:
        """V^-1 times the columns of the other laws, (d n, k)."""
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
        """Precomputed products for each thing that the changing law moves."""
        screen, evidence = self.screen, self.screen.evidence
        fixed = joined([evidence.possible, Plain(screen.weighed), Plain(self._weighed)])
        found = {}
        for moved, _ in screen.pairs(self.laws[self.number]):
            if moved not in found:
                m = screen.moved(moved)
                shared = evidence.rest.seen_by_sample(m)
                found[moved] = _Given(m, fixed.through(m).dense, shared, evidence.rest.samples)
        return found


@dataclass(frozen=True)
class _Given:
    """Contribution of each sample to the products of m f with fixed columns, for any f."""

    m: Array  # (n, d)
    along: Array  # (n, A + 1 + k): with nuisance, residuals and other columns
    shared: tuple[Array, ...]  # (samples, r) projections onto the rest errors of each episode
    samples: tuple[slice, ...]  # of these episodes

    def shared_of(self, f: Array) -> Array:
        """Projection of m f onto the rest errors that paths share, (r,)."""
        parts = [f[rows] @ own for rows, own in zip(self.samples, self.shared, strict=True)]
        return np.concatenate([np.zeros(0), *parts])


def _batches(
    laws: Sequence[FoundLaw], pairs: Sequence[Sequence[Column]]
) -> Iterator[list[list[int]]]:
    """Batches of sets of laws: a set has one shape; sets of a batch have equally many columns."""
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
    """Key of a law's shape: everything but its targets."""
    return law.stage, law.of, law.function, law.by, law.middle, law.scale, law.bearing
