"""Whitened columns of candidate causes; those of a smooth map are kept as products.

A map has F functions phi of the sample and moves every joint j by each function f:

    x_fj = m_j phi_f        m (n, d, m): whitened d(reading)/d(joint),    phi (n, F)

The inner products of its columns need only sums over the samples,

    x_fj' y = sum phi_f (m_j . y)        x_fj' x_gk = sum phi_f phi_g (m_j . m_k)

and X v needs m only once for all functions. The columns themselves would be hundreds, each as
long as the session. In an error curve each function moves one joint only and is zero at most
samples: its columns are kept as a sparse matrix.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from delta_calibration.diagnosis import narrow
from delta_calibration.lazy import cached_property
from delta_calibration.threads import mapped

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_AT_A_TIME = 32  # columns
Samples = slice | NDArray[Any]  # indices or a mask


class Columns(ABC):
    """A set of k columns, each with d numbers for each of n samples."""

    @property
    @abstractmethod
    def width(self) -> int:
        """Number of columns, k."""

    @abstractmethod
    def along(self, y: Array) -> Array:
        """Products X' y with dense columns y (d n, j), (k, j)."""

    @abstractmethod
    def inner(self) -> Array:
        """Products X' X of these columns with each other, (k, k)."""

    @abstractmethod
    def across(self, other: Columns) -> Array:
        """Products X' Z with l columns Z of any kind, (k, l)."""

    @abstractmethod
    def times(self, values: Array) -> Array:
        """Products X v with values v (k, j), (d n, j)."""

    @property
    @abstractmethod
    def dense(self) -> Array:
        """The columns as a dense matrix, (d n, k)."""

    @abstractmethod
    def squares(self, d: int) -> Array:
        """Squared length of each sample's d numbers over all columns, (n,)."""

    @abstractmethod
    def through(self, m: Array) -> Columns:
        """Products m . x of each sample with m (n, d): columns of one number for each sample."""

    @property
    def flat(self) -> tuple[Columns, ...]:
        """Parts of one kind each; `order` gives the positions of the columns among them."""
        return (self,)

    @property
    def order(self) -> Index:
        """Position of each column among the columns of `flat`, (k,)."""
        return np.arange(self.width)

    @abstractmethod
    def part(self, samples: Samples, d: int) -> Columns:
        """The columns at some of the samples, which have d numbers each."""

    @abstractmethod
    def weighed(self, root: Array) -> Columns:
        """The columns multiplied by `root` (n, 1, 1), the root of each sample's weight."""


@dataclass(frozen=True)
class Matrix(Columns):
    """Columns that are kept as a matrix."""

    values: Any  # (d n, k), dense or sparse

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.values.shape[1])

    def along(self, y: Array) -> Array:
        """X' y, (k, j)."""
        return np.asarray(self.values.T @ y)

    def times(self, values: Array) -> Array:
        """X v, (d n, j)."""
        return np.asarray(self.values @ values)


@dataclass(frozen=True)
class Plain(Matrix):
    """Dense columns."""

    values: Array  # (d n, k)

    def along(self, y: Array) -> Array:
        """X' y, (k, j)."""
        return narrow.along(self.values, y)

    def inner(self) -> Array:
        """X' X, (k, k)."""
        return self.along(self.values)

    def across(self, other: Columns) -> Array:
        """X' Z, (k, l)."""
        return np.asarray(other.along(self.values).T)

    @property
    def dense(self) -> Array:
        """The columns as a dense matrix, (d n, k)."""
        return self.values

    def squares(self, d: int) -> Array:
        """Squared length of each sample over all columns, (n,)."""
        each = self.values.reshape(len(self.values) // d, d * self.width)
        return np.asarray(np.sum(each**2, axis=1))

    def through(self, m: Array) -> Plain:
        """Products m . x of each sample, (n, k)."""
        each = self.values.reshape(*m.shape, self.width)
        return Plain(np.einsum("nc,nck->nk", m, each))

    def part(self, samples: Samples, d: int) -> Plain:
        """The columns at some of the samples."""
        each = self.values.reshape(len(self.values) // d, d, self.width)[samples]
        return Plain(each.reshape(len(each) * d, self.width))

    def weighed(self, root: Array) -> Plain:
        """The columns multiplied by the root of each sample's weight."""
        each = root * self.values.reshape(len(root), len(self.values) // len(root), self.width)
        return Plain(each.reshape(self.values.shape))


@dataclass(frozen=True)
class Product(Columns):
    """Columns x_fj = m_j phi_f, sorted by function f, then by joint j."""

    moved: Array  # (n, d, m)
    functions: Array  # (n, F)

    @property
    def width(self) -> int:
        """Number of columns, F m."""
        return int(self.functions.shape[1] * self.moved.shape[2])

    def along(self, y: Array) -> Array:
        """X' y, (k, j)."""
        n, d, _ = self.moved.shape
        if y.shape[1] == 1:  # matmul would make thousands of calls for small matrices
            moved = np.einsum("ncm,nc->nm", self.moved, y.reshape(n, d))
            return np.asarray(self.functions.T @ moved).reshape(self.width, 1)
        by_joints, each = self.moved.swapaxes(1, 2), y.reshape(n, d, -1)
        found = np.empty((self.functions.shape[1], self.moved.shape[2], y.shape[1]))
        for begin in range(0, y.shape[1], _AT_A_TIME):  # in blocks: `moved` is large
            moved = by_joints @ each[..., begin : begin + _AT_A_TIME]
            along = self.functions.T @ moved.reshape(n, -1)
            found[..., begin : begin + _AT_A_TIME] = along.reshape(*found.shape[:2], -1)
        return found.reshape(self.width, -1)

    def inner(self) -> Array:
        """X' X, (k, k); 2 m_j . m_k = |m_j + m_k|^2 - |m_j|^2 - |m_k|^2 halves the work."""
        moved, count = self.moved, self.functions.shape[1]
        m = moved.shape[2]
        pairs = [(j, k) for j in range(m) for k in range(j + 1)]

        def squared(pair: tuple[int, int]) -> Array:
            j, k = pair
            return self._squared(moved[:, :, j] + moved[:, :, k] if k < j else moved[:, :, j])

        of = dict(zip(pairs, mapped(squared, pairs), strict=True))
        found = np.empty((count, m, count, m))
        for j, k in pairs:
            here = of[j, j] if k == j else (of[j, k] - of[j, j] - of[k, k]) / 2
            found[:, j, :, k] = found[:, k, :, j] = here
        return found.reshape(self.width, self.width)

    def _squared(self, moved: Array) -> Array:
        """Products of the functions, (F, F), each sample weighted by |moved|^2, moved (n, d)."""
        weighed = np.sqrt(np.einsum("nc,nc->n", moved, moved))[:, None] * self.functions
        return np.asarray(weighed.T @ weighed)

    def across(self, other: Columns) -> Array:
        """X' Z, (k, l)."""
        if isinstance(other, Product):
            return self._products(other)
        return np.asarray(other.across(self).T)

    def times(self, values: Array) -> Array:
        """X v, (d n, j): first the joint displacements, then the shift of the readings by them."""
        n, d, m = self.moved.shape
        each = self.functions @ values.reshape(self.functions.shape[1], -1)
        return np.asarray(self.moved @ each.reshape(n, m, -1)).reshape(n * d, -1)

    @property
    def dense(self) -> Array:
        """The columns as a dense matrix, (d n, k)."""
        each = self.moved[:, :, None, :] * self.functions[:, None, :, None]
        return each.reshape(-1, self.width)

    def squares(self, d: int) -> Array:
        """Squared length of each sample over all columns, (n,)."""
        moved = np.sum(self.moved**2, axis=(1, 2))
        return np.asarray(moved * np.sum(self.functions**2, axis=1))

    def through(self, m: Array) -> Product:
        """Products m . x of each sample, (n, k): m . m_j once for all functions."""
        return Product(np.einsum("nc,ncm->nm", m, self.moved)[:, None], self.functions)

    def part(self, samples: Samples, d: int) -> Product:
        """The columns at some of the samples."""
        return Product(self.moved[samples], self.functions[samples])

    def weighed(self, root: Array) -> Product:
        """The columns multiplied by the root of each sample's weight."""
        return Product(root * self.moved, self.functions)

    def _products(self, other: Product) -> Array:
        """X' Z by pairs of joints; symmetric in the pair if both use the same `moved`."""
        weight = self.moved.swapaxes(1, 2) @ other.moved
        m, others = weight.shape[1:]
        alike = self.moved is other.moved
        pairs = [(j, k) for j in range(m) for k in range(j if alike else 0, others)]

        def product(pair: tuple[int, int]) -> Array:
            j, k = pair
            return np.asarray(self.functions.T @ (weight[:, j, k, None] * other.functions))

        found = np.empty((self.functions.shape[1], m, other.functions.shape[1], others))
        for (j, k), here in zip(pairs, mapped(product, pairs), strict=True):
            found[:, j, :, k] = here
            if alike and k > j:
                found[:, k, :, j] = here
        return found.reshape(self.width, other.width)


@dataclass(frozen=True)
class Sparse(Matrix):
    """Columns that are zero at most samples."""

    values: csr_array  # (d n, k)

    @classmethod
    def of(cls, moved: Array, functions: Array, moves: Index) -> Sparse:
        """Columns m_j f of functions f (k, n); j is `moves` (k,), and m_j of `moved` (n, d, m)."""
        column, sample = np.nonzero(functions)
        n, d, _ = moved.shape
        values = moved[sample, :, moves[column]] * functions[column, sample][:, None]
        row = d * sample[:, None] + np.arange(d)
        place = row.ravel(), np.repeat(column, d)
        return cls(csr_array((values.ravel(), place), shape=(n * d, len(functions))))

    def inner(self) -> Array:
        """X' X, (k, k)."""
        return np.asarray((self.values.T @ self.values).toarray())

    def across(self, other: Columns) -> Array:
        """X' Z, (k, l)."""
        if isinstance(other, Sparse):
            return np.asarray((self.values.T @ other.values).toarray())
        if isinstance(other, Product):
            each = np.moveaxis(other.moved, 2, 0)
            met = [self.through(m).values.T @ other.functions for m in each]
            return np.stack(met, axis=-1).reshape(self.width, other.width)
        return np.asarray(other.across(self).T)

    @property
    def dense(self) -> Array:
        """The columns as a dense matrix, (d n, k)."""
        return np.asarray(self.values.toarray())

    def squares(self, d: int) -> Array:
        """Squared length of each sample over all columns, (n,)."""
        squares = np.asarray(self.values.power(2).sum(axis=1))
        return np.asarray(squares.reshape(-1, d).sum(axis=1))

    def through(self, m: Array) -> Sparse:
        """Products m . x of each sample, (n, k)."""
        n, d = m.shape
        entries = m.ravel(), np.arange(n * d), np.arange(0, n * d + 1, d)
        along = csr_array(entries, shape=(n, n * d))
        return Sparse(csr_array(along @ self.values))

    def part(self, samples: Samples, d: int) -> Sparse:
        """The columns at some of the samples."""
        n = self.values.shape[0] // d
        if isinstance(samples, slice):
            begin, end, step = samples.indices(n)
            if step == 1:
                return Sparse(self.values[d * begin : d * end])
        every = np.arange(n * d).reshape(n, d)
        return Sparse(self.values[every[samples].ravel()])

    def weighed(self, root: Array) -> Sparse:
        """The columns multiplied by the root of each sample's weight."""
        each = np.repeat(root.ravel(), self.values.shape[0] // len(root))
        return Sparse(csr_array(diags_array(each) @ self.values))


@dataclass(frozen=True)
class Joined(Columns):
    """Columns of several parts in a given order: all dense ones, each product, each sparse set."""

    parts: tuple[Columns, ...]
    stand: Index  # (k,) position of each column among those of the parts

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.stand)

    def along(self, y: Array) -> Array:
        """X' y, (k, j)."""
        parts = [part.along(y) for part in self.parts]
        return np.concatenate([np.zeros((0, y.shape[1])), *parts])[self.stand]

    def inner(self) -> Array:
        """X' X, (k, k)."""
        found = np.empty((self.width, self.width))
        spans = [slice(*span) for span in pairwise(self._begin)]
        for i, own in enumerate(spans):
            found[own, own] = self.parts[i].inner()
            for part, span in zip(self.parts[:i], spans[:i], strict=True):
                found[own, span] = self.parts[i].across(part)
                found[span, own] = found[own, span].T
        return found[self.stand[:, None], self.stand]

    def across(self, other: Columns) -> Array:
        """X' Z, (k, l)."""
        parts = [part.across(other) for part in self.parts]
        return np.concatenate([np.zeros((0, other.width)), *parts])[self.stand]

    def times(self, values: Array) -> Array:
        """X v, (d n, j)."""
        own = np.empty_like(values)
        own[self.stand] = values
        spans = [slice(*span) for span in pairwise(self._begin)]
        made = (p.times(own[span]) for p, span in zip(self.parts, spans, strict=True))
        return np.asarray(sum(made))

    @property
    def dense(self) -> Array:
        """The columns as a dense matrix, (d n, k)."""
        return np.concatenate([part.dense for part in self.parts], axis=1)[:, self.stand]

    def squares(self, d: int) -> Array:
        """Squared length of each sample over all columns, (n,)."""
        return np.asarray(sum(part.squares(d) for part in self.parts))

    def through(self, m: Array) -> Joined:
        """Products m . x of each sample, (n, k)."""
        return replace(self, parts=tuple(part.through(m) for part in self.parts))

    @property
    def flat(self) -> tuple[Columns, ...]:
        """The parts."""
        return self.parts

    @property
    def order(self) -> Index:
        """Position of each column among those of the parts, (k,)."""
        return self.stand

    def part(self, samples: Samples, d: int) -> Joined:
        """The columns at some of the samples."""
        return replace(self, parts=tuple(part.part(samples, d) for part in self.parts))

    def weighed(self, root: Array) -> Joined:
        """The columns multiplied by the root of each sample's weight."""
        return replace(self, parts=tuple(part.weighed(root) for part in self.parts))

    @cached_property
    def _begin(self) -> tuple[int, ...]:
        """Index of the first column of each part, then the number of columns."""
        return tuple(np.cumsum([0, *(part.width for part in self.parts)]).tolist())


def joined(every: Sequence[Columns]) -> Columns:
    """Concatenate several sets of columns."""
    if len(every) == 1:
        return every[0]
    begin, flat = 0, []  # part of one kind, and where its columns go
    for columns in every:
        order, at = columns.order, 0
        for part in columns.flat:
            stand = np.flatnonzero((order >= at) & (order < at + part.width))
            stand = stand[np.argsort(order[stand])]
            flat.append((part, begin + stand))
            at += part.width
        begin += columns.width
    plain = [pair for pair in flat if isinstance(pair[0], Plain)]
    others = [pair for pair in flat if not isinstance(pair[0], Plain)]
    parts = [part for part, _ in others]
    if plain:
        parts.insert(0, Plain(np.concatenate([cast(Plain, p).values for p, _ in plain], axis=1)))
    stands = [np.zeros(0, dtype=np.int64), *(stand for _, stand in (*plain, *others))]
    return Joined(tuple(parts), np.argsort(np.concatenate(stands)))
