"""Products of many shapes of explanations about one evidence.

A value that moves one joint by a function of the sample has the column

    x = m f        m (n, d): whitened d(reading) by the joint,    f (n,): the function

and products with anything that stays, where another function is tried, are

    x' y = sum f (m . y)

What each joint gives to them is worked out once; another shape then costs as much as its
functions, a third of its columns, and those are never built.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate, columns_of
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.effects import Stage
from delta_calibration.effects.apart import Apart, functions_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Shapes:
    """An evidence, ready for products of many columns with it and with each other."""

    evidence: LinearizedModel
    weighed: Array  # (d n, j) what is asked of each column

    @classmethod
    def of(cls, evidence: LinearizedModel) -> Shapes:
        """Ready for what explains its residuals."""
        return cls(evidence, evidence.weigh(evidence.column))

    @cached_property
    def _moved(self) -> Array:
        """By each joint, (m, d, n)."""
        return np.ascontiguousarray(self.evidence.by_joints.transpose(2, 1, 0))

    @cached_property
    def _along(self) -> Array:
        """Of each joint m . y of what is weighed, then of plain nuisance, (m, n, j + a)."""
        parts = self.evidence.possible.flat  # what is plain of them is the first
        plain = [part.values for part in parts if isinstance(part, Plain)]
        stays = Plain(np.concatenate([self.weighed, *plain], axis=1))
        each = self.evidence.by_joints.transpose(2, 0, 1)
        return np.stack([stays.through(m) for m in each])

    @cached_property
    def _shared(self) -> tuple[tuple[Array, ...], ...]:
        """Of each joint what its samples give to rest errors, by episode, (samples, r)."""
        each = self.evidence.by_joints.transpose(2, 0, 1)
        return tuple(self.evidence.rest.seen_by_sample(m) for m in each)

    def products(self, shapes: Sequence[Candidate]) -> tuple[Array, Array]:
        """Information of each, (L, k, k), and products with what is weighed, (L, k, j).

        Args:
            shapes: of as many columns each.
        """
        apart = self._apart(shapes)
        return self._of_columns(shapes) if apart is None else self._of_functions(apart)

    def _apart(self, shapes: Sequence[Candidate]) -> list[Apart] | None:
        """The shapes by functions, where each value of all of them moves one joint, the same."""
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
        """Products of columns that are built."""
        columns = np.concatenate([columns_of(shape, self.evidence) for shape in shapes], axis=1)
        k = columns.shape[1] // len(shapes)
        along = (columns.T @ self.weighed).reshape(len(shapes), k, -1)
        return self.evidence.information_of_each(columns, k), along

    def _of_functions(self, shapes: Sequence[Apart]) -> tuple[Array, Array]:
        """Products of functions."""
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
        """Products of functions (j, n) of a joint with what is weighed, then the nuisance."""
        m = self.evidence.by_joints[:, :, joint]
        others = (p for p in self.evidence.possible.flat if not isinstance(p, Plain))
        met = (other.met(m, functions) for other in others)
        return np.concatenate([functions @ self._along[joint], *met], axis=1)

    def _seen(self, joint: int, functions: Array) -> Array:
        """What of functions (j, n) of a joint looks like rest errors, (j, r)."""
        every = zip(self.evidence.rest.samples, self._shared[joint], strict=True)
        found = [functions[:, rows] @ by_sample for rows, by_sample in every]
        return np.concatenate([np.zeros((len(functions), 0)), *found], axis=1)

    def _inner(self, functions: Array, place: Index, moves: Index) -> Array:
        """Products of the columns of each shape with each other, (L, k, k)."""
        moved = self._moved[moves]
        columns = np.empty_like(moved)
        inner = np.empty((*place.shape, place.shape[1]))
        flat = columns.reshape(len(moves), -1)
        for into, own in zip(inner, place, strict=True):
            np.multiply(moved, functions[own][:, None], out=columns)
            np.matmul(flat, flat.T, out=into)
        return inner


def _place(count: int, moves: Index) -> Index:
    """Rows of the values of each shape, (L, k): those of a joint follow each other."""
    place = np.empty((count, len(moves)), dtype=np.int64)
    begin = 0
    for joint in np.unique(moves):
        own = np.flatnonzero(moves == joint)
        place[:, own] = begin + np.arange(count * len(own)).reshape(count, -1)
        begin += count * len(own)
    return place
