"""Whitened columns of explanations, those of a smooth map as products never multiplied out.

A map has functions phi of the sample, and moves every joint by each of them:

    x_fj = m_j phi_f        m (n, d, m): whitened d(reading) by the joints,    phi (n, F)

What is asked of its columns needs only sums over samples of small things,

    x_fj' y = sum phi_f (m_j . y)        x_fj' x_gk = sum phi_f phi_g (m_j . m_k)

where the columns themselves are hundreds, each as long as the session.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Columns(ABC):
    """Some columns, k: each has d numbers for each of n samples."""

    @property
    @abstractmethod
    def width(self) -> int:
        """How many there are, k."""

    @abstractmethod
    def along(self, y: Array) -> Array:
        """Products X' y with other columns y (d n, j), (k, j)."""

    @abstractmethod
    def inner(self) -> Array:
        """Products X' X of these columns with each other, (k, k)."""

    @abstractmethod
    def across(self, other: Columns) -> Array:
        """Products X' Z with l others of any kind, (k, l)."""

    @abstractmethod
    def rows(self, own: slice) -> Columns:
        """Some of the coordinates, those of whole samples."""


@dataclass(frozen=True)
class Plain(Columns):
    """Columns as they are."""

    values: Array  # (d n, k)

    @property
    def width(self) -> int:
        """How many there are."""
        return int(self.values.shape[1])

    def along(self, y: Array) -> Array:
        """X' y, (k, j)."""
        return np.asarray(self.values.T @ y)

    def inner(self) -> Array:
        """X' X, (k, k)."""
        return self.along(self.values)

    def across(self, other: Columns) -> Array:
        """X' Z, (k, l)."""
        return np.asarray(other.along(self.values).T)

    def rows(self, own: slice) -> Plain:
        """Some of the coordinates."""
        return Plain(self.values[own])


@dataclass(frozen=True)
class Product(Columns):
    """Columns x_fj = m_j phi_f, those of one function after those of another."""

    moved: Array  # (n, d, m)
    functions: Array  # (n, F)

    @property
    def width(self) -> int:
        """How many there are: F m."""
        return int(self.functions.shape[1] * self.moved.shape[2])

    def along(self, y: Array) -> Array:
        """X' y, (k, j)."""
        n, d, _ = self.moved.shape
        moved = self.moved.swapaxes(1, 2) @ y.reshape(n, d, -1)
        return np.asarray(self.functions.T @ moved.reshape(n, -1)).reshape(self.width, -1)

    def inner(self) -> Array:
        """X' X, (k, k)."""
        return self._products(self)

    def across(self, other: Columns) -> Array:
        """X' Z, (k, l)."""
        if isinstance(other, Product):
            return self._products(other)
        return np.asarray(other.across(self).T)

    def rows(self, own: slice) -> Product:
        """Some of the coordinates."""
        d = self.moved.shape[1]
        samples = slice(own.start // d, own.stop // d)
        return Product(self.moved[samples], self.functions[samples])

    def _products(self, other: Product) -> Array:
        """X' Z, by the pairs of joints; those of one machine are the same both ways round."""
        pairs = self.moved.swapaxes(1, 2) @ other.moved
        m, others = pairs.shape[1:]
        found = np.empty((self.functions.shape[1], m, other.functions.shape[1], others))
        alike = self.moved is other.moved
        for j in range(m):
            for k in range(j if alike else 0, others):
                weighed = pairs[:, j, k, None] * other.functions
                found[:, j, :, k] = self.functions.T @ weighed
                if alike and k > j:
                    found[:, k, :, j] = found[:, j, :, k]
        return found.reshape(self.width, other.width)


@dataclass(frozen=True)
class Joined(Columns):
    """Columns of one kind after those of another."""

    parts: tuple[Columns, ...]

    @property
    def width(self) -> int:
        """How many there are."""
        return self._begin[-1]

    def along(self, y: Array) -> Array:
        """X' y, (k, j)."""
        parts = [part.along(y) for part in self.parts]
        return np.concatenate([np.zeros((0, y.shape[1])), *parts])

    def inner(self) -> Array:
        """X' X, (k, k)."""
        found = np.empty((self.width, self.width))
        spans = [slice(*span) for span in pairwise(self._begin)]
        for i, own in enumerate(spans):
            found[own, own] = self.parts[i].inner()
            for part, span in zip(self.parts[:i], spans[:i], strict=True):
                found[own, span] = self.parts[i].across(part)
                found[span, own] = found[own, span].T
        return found

    def across(self, other: Columns) -> Array:
        """X' Z, (k, l)."""
        parts = [part.across(other) for part in self.parts]
        return np.concatenate([np.zeros((0, other.width)), *parts])

    def rows(self, own: slice) -> Joined:
        """Some of the coordinates."""
        return Joined(tuple(part.rows(own) for part in self.parts))

    @cached_property
    def _begin(self) -> tuple[int, ...]:
        """Where the columns of each begin, and where all end."""
        return tuple(np.cumsum([0, *(part.width for part in self.parts)]).tolist())


def joined(parts: Sequence[Columns]) -> Columns:
    """All of some columns, one after the other."""
    return parts[0] if len(parts) == 1 else Joined(tuple(parts))
