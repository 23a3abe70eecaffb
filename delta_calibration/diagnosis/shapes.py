"""Inner products of the columns of many shapes of explanations about one evidence.

A value that moves one joint by a function of the sample has the column

    x = m f        m (n, d): whitened d(reading) / d(joint),    f (n,): the function

and its product with a column y that is the same for all functions is

    x' y = sum f (m . y)

The dot products m . y of each joint are computed once. Another shape then costs only its
functions, a third of the size of its columns; these are built one shape at a time at most.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate, columns_of
from delta_calibration.diagnosis.columns import Columns, Plain
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.waves import Grid, Laid, Waves
from delta_calibration.effects import Effect, Stage
from delta_calibration.effects.apart import Apart, functions_of
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AT_A_TIME, _WAVES = 8, 64  # shapes in memory together


@dataclass(frozen=True)
class Shapes:
    """Precomputed products about one evidence, for the columns of many shapes."""

    evidence: LinearizedModel
    weighed: Array  # (d n, j) V^-1 of residuals and draws, with which columns are multiplied

    @classmethod
    def of(cls, evidence: LinearizedModel) -> Shapes:
        """Products for explanations of the residuals of an evidence."""
        return cls(evidence, evidence.weigh(evidence.column))

    @cached_property
    def moved(self) -> Array:
        """Whitened d(reading) / d(joint) of each joint, (m, d, n)."""
        return np.ascontiguousarray(self.evidence.by_joints.transpose(2, 1, 0))

    @cached_property
    def _along(self) -> Array:
        """m . y of each joint with `weighed`, then with the plain nuisance, (m, n, j + a)."""
        parts = self.evidence.possible.flat  # plain columns come first
        plain = [part.values for part in parts if isinstance(part, Plain)]
        stays = Plain(np.concatenate([self.weighed, *plain], axis=1))
        each = self.evidence.by_joints.transpose(2, 0, 1)
        return np.stack([stays.through(m).values for m in each])

    @cached_property
    def _products(self) -> tuple[tuple[Columns, ...], ...]:
        """m . y of each joint with the other nuisance, which is not kept as plain columns."""
        others = [part for part in self.evidence.possible.flat if not isinstance(part, Plain)]
        each = self.evidence.by_joints.transpose(2, 0, 1)
        return tuple(tuple(part.through(m) for part in others) for m in each)

    @cached_property
    def _shared(self) -> tuple[tuple[Array, ...], ...]:
        """Projection of each joint's samples onto the rest errors, by episode, (samples, r)."""
        each = self.evidence.by_joints.transpose(2, 0, 1)
        return tuple(self.evidence.rest.seen_by_sample(m) for m in each)

    def stays(self, joint: int) -> Array:
        """m . y of a joint with all fixed columns: `weighed`, then the nuisance, (n, j + A)."""
        others = (part.dense for part in self._products[joint])
        return np.concatenate([self._along[joint], *others], axis=1)

    def shared(self, joint: int) -> Array:
        """Projection of a joint's samples onto the rest errors of all episodes, (n, r)."""
        found, at = np.zeros((len(self.evidence), len(self.evidence.rest.weak))), 0
        for rows, own in zip(self.evidence.rest.samples, self._shared[joint], strict=True):
            found[rows, at : at + own.shape[1]] = own
            at += own.shape[1]
        return found

    def each(
        self, candidates: Sequence[Candidate]
    ) -> Iterator[tuple[Sequence[Candidate], Array, Array]]:
        """Batches of candidates, information (L, k, k) and products with `weighed` (L, k, j).

        Args:
            candidates: with k columns each.
        """
        waves = self._waves(candidates)
        step = _AT_A_TIME if waves is None else _WAVES
        for first in range(0, len(candidates), step):
            some = candidates[first : first + step]
            information, along = self.products(some) if waves is None else waves.products(some)
            yield some, information, along

    def products(self, shapes: Sequence[Candidate]) -> tuple[Array, Array]:
        """Information (L, k, k) and products with `weighed` (L, k, j) of one batch."""
        apart = self._apart(shapes)
        return self._of_columns(shapes) if apart is None else self._of_functions(apart)

    def _waves(self, shapes: Sequence[Candidate]) -> _OfWaves | None:
        """Products by a grid, if all shapes are waves of the same joints and many; else None."""
        orders = [None if s.effect is None else s.effect.order for s in shapes]
        if any(order is None for order in orders) or len({s.rows for s in shapes}) > 1:
            return None
        known = np.array(orders, dtype=float)
        grid = Grid.fine(known, self.evidence.at.joint)
        return None if grid is None else _OfWaves(self, shapes[0].rows, grid)

    def _apart(self, shapes: Sequence[Candidate]) -> list[Apart] | None:
        """The shapes as functions, if each value moves one joint, the same in all; else None."""
        found: list[Apart] = []
        for shape in shapes:
            if shape.effect is None or shape.effect.stage is not Stage.DRIVE:
                return None
            places = self.evidence.signals(shape.effect).places
            own = Apart.of(shape.effect, shape.rows, places)
            if own is None or own.moves != (found or [own])[0].moves:
                return None
            found.append(own)
        return found

    def _of_columns(self, shapes: Sequence[Candidate]) -> tuple[Array, Array]:
        """Information and products from columns that are multiplied out."""
        columns = np.concatenate([columns_of(shape, self.evidence) for shape in shapes], axis=1)
        k = columns.shape[1] // len(shapes)
        along = (columns.T @ self.weighed).reshape(len(shapes), k, -1)
        return self.evidence.information_of_each(columns, k), along

    def _of_functions(self, shapes: Sequence[Apart]) -> tuple[Array, Array]:
        """Information and products from functions; columns are built one shape at a time."""
        moves = np.array(shapes[0].moves)
        place = _place(len(shapes), moves)
        signals = self.evidence.signals(shapes[0].effect)
        functions = functions_of(shapes, signals, place)
        count, width = len(shapes), self.weighed.shape[1]
        along = np.empty((*place.shape, width + self.evidence.possible.width))
        shared = np.empty((*place.shape, len(self.evidence.rest.weak)))
        for joint in np.unique(moves):
            own = np.flatnonzero(moves == joint)
            some = functions[place[0, own[0]] : place[-1, own[-1]] + 1]
            shape = count, len(own), -1
            along[:, own] = self._met(joint, some).reshape(shape)
            shared[:, own] = self._seen(joint, some).reshape(shape)
        across = along[..., width + self.evidence.possible.order]
        inner = self._inner(functions, place, moves)
        return self.evidence.left_of_each(inner, across, shared), along[..., :width]

    def _met(self, joint: int, functions: Array) -> Array:
        """Products of columns m f of a joint, f (j, n), with `weighed` and the nuisance."""
        met = (part.along(functions.T).T for part in self._products[joint])
        return np.concatenate([functions @ self._along[joint], *met], axis=1)

    def _seen(self, joint: int, functions: Array) -> Array:
        """Projection of columns m f of a joint, f (j, n), onto the rest errors, (j, r)."""
        every = zip(self.evidence.rest.samples, self._shared[joint], strict=True)
        found = [functions[:, rows] @ by_sample for rows, by_sample in every]
        return np.concatenate([np.zeros((len(functions), 0)), *found], axis=1)

    def _inner(self, functions: Array, place: Index, moves: Index) -> Array:
        """Products of the columns of each shape with each other, (L, k, k)."""
        moved = self.moved[moves]
        columns = np.empty_like(moved)
        inner = np.empty((*place.shape, place.shape[1]))
        flat = columns.reshape(len(moves), -1)
        for into, own in zip(inner, place, strict=True):
            np.multiply(moved, functions[own][:, None], out=columns)
            np.matmul(flat, flat.T, out=into)
        return inner


@dataclass(frozen=True)
class _OfWaves:
    """Products of waves of the joints, computed on a grid of the joint angles."""

    about: Shapes
    values: tuple[int, ...]  # (k,) indices of an effect's free parameters
    grid: Grid

    def products(self, shapes: Sequence[Candidate]) -> tuple[Array, Array]:
        """Information (L, k, k) of each shape, and products with `weighed` (L, k, j)."""
        effects = [cast(Effect, shape.effect) for shape in shapes]
        orders = np.array([effect.order for effect in effects], dtype=float)
        waves = Waves(self.grid, orders, self._points)
        evidence, width = self.about.evidence, self.about.weighed.shape[1]
        both = {joint: waves.sums(laid) for joint, laid in self._laid.items()}
        along = np.stack([both[j][i] for j, i in self._each], axis=1)
        across = along[..., width : width + evidence.possible.width]
        across = across[..., evidence.possible.order]
        shared = along[..., width + evidence.possible.width :]
        inner = self._inner(waves)
        found = evidence.left_of_each(inner, across, shared)
        size = np.array([effect.parameters.prior[list(self.values)] for effect in effects])
        return size[:, :, None] * found * size[:, None], size[..., None] * along[..., :width]

    @property
    def _joints(self) -> int:
        return int(self.about.evidence.by_joints.shape[2])

    @property
    def _each(self) -> list[tuple[int, int]]:
        """For each value its joint, and 0 if it is a sine or 1 if a cosine."""
        return [(value % self._joints, value // self._joints) for value in self.values]

    @cached_property
    def _own(self) -> tuple[int, ...]:
        """The joints that the values move."""
        return tuple(dict.fromkeys(joint for joint, _ in self._each))

    @cached_property
    def _angle(self) -> Array:
        """Angles of each joint at the samples, (m, n) [rad, m]."""
        return np.ascontiguousarray(self.about.evidence.at.joint.T)

    @cached_property
    def _points(self) -> int:
        """Points of the longest grid: for sums and differences of two joint angles."""
        width = np.sort(np.ptp(self._angle[list(self._own)], axis=1))
        return self.grid.points(2 * float(width[-1]))

    @cached_property
    def _laid(self) -> dict[int, Laid]:
        """Fixed columns and rest errors of each joint, spread on the grid of its angle."""
        found = {}
        for joint in self._own:
            columns = np.concatenate([self.about.stays(joint), self.about.shared(joint)], axis=1)
            found[joint] = self.grid.laid(self._angle[joint], columns)
        return found

    @cached_property
    def _pairs(self) -> dict[tuple[int, int], tuple[Laid, Laid]]:
        """m_r . m_s of two joints, on grids of the difference and the sum of their angles."""
        found, moved = {}, self.about.moved
        for r, s in combinations_with_replacement(self._own, 2):
            both = np.einsum("cn,cn->n", moved[r], moved[s])[:, None]
            q, p = self._angle[r], self._angle[s]
            found[r, s] = self.grid.laid(q - p, both), self.grid.laid(q + p, both)
        return found

    def _inner(self, waves: Waves) -> Array:
        """Products of the columns of each order, (L, k, k): 2 sin a sin b = cos a-b - cos a+b."""
        found = np.empty((len(waves.orders), len(self.values), len(self.values)))
        each = self._each
        sums = {pair: [waves.sums(laid) for laid in both] for pair, both in self._pairs.items()}
        for i, (r, of_r) in enumerate(each):
            for k, (s, of_s) in enumerate(each[: i + 1]):
                pair, ahead = ((r, s), 1.0) if (r, s) in sums else ((s, r), -1.0)
                (less_sin, less_cos), (more_sin, more_cos) = (
                    tuple(part[:, 0] for part in both) for both in sums[pair]
                )
                product = {
                    (0, 0): less_cos - more_cos,
                    (1, 1): less_cos + more_cos,
                    (0, 1): more_sin + ahead * less_sin,
                    (1, 0): more_sin - ahead * less_sin,
                }[of_r, of_s]
                found[:, i, k] = found[:, k, i] = product / 2
        return found


def _place(count: int, moves: Index) -> Index:
    """Row of each value of each shape, (L, k), with the rows of each joint contiguous."""
    place = np.empty((count, len(moves)), dtype=np.int64)
    begin = 0
    for joint in np.unique(moves):
        own = np.flatnonzero(moves == joint)
        place[:, own] = begin + np.arange(count * len(own)).reshape(count, -1)
        begin += count * len(own)
    return place
