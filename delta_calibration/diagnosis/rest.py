"""Where the joints came to rest before a motion: an error that goes along with all of it.

A motion's readings share how far off its command each joint was when it began, u with spread s,
which along the motion may pass into what it ends with. A machine that turns round where it has
come to may keep its error, or not: such paths share one and have one of their own as well. The
covariance of the readings of paths in a row is

    C = 1 + B B^T        B: whitened columns of s u, of what they share, have and pass into

Otherwise paths have nothing to do with one another: C is made of blocks, and its inverse root

    C^(-1/2) = 1 - B Q diag(k) Q^T B^T      B^T B = Q diag(l) Q^T,   k = (1 - (1 + l)^(-1/2)) / l

costs as much as there are readings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.samples import Conditions

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AT_REST = -1  # path of the poses
_LEAST = 1e-12
_PAUSE, _AWAY = 5.0, 0.02  # [s], [rad] between paths in a row, at most


@dataclass(frozen=True)
class Rest:
    """Rest errors of the paths among n samples; a path's samples follow each other."""

    path: Index  # (n,) number of the path, `AT_REST` for poses
    row: Index  # (n,) number of the paths in a row, each of which begins where the last has ended
    own: Array  # (n, 3, m) whitened, of an error in its spread; of no matter for poses
    passing: Array  # (n, 3, m) of one that goes from half less to half more

    @classmethod
    def of(cls, path: Index, at: Conditions, by_joints: Array) -> Rest:
        """Of the paths of samples.

        Args:
            path: number of each sample's path (n,), `AT_REST` for poses.
            at: joint angles and times.
            by_joints: whitened d(reading) by the joints' rest errors in their spread, (n, 3, m).
        """
        course = np.zeros(len(path))
        for number in np.unique(path[path != AT_REST]):
            on = path == number
            course[on] = np.linspace(-0.5, 0.5, int(on.sum()))
        passing = np.sqrt(2) * course[:, None, None] * by_joints  # two draws differ by so much
        return cls(path, _rows(path, at), by_joints, passing)

    def take(self, rows: NDArray[np.intp]) -> Rest:
        """Of some of the samples."""
        return Rest(self.path[rows], self.row[rows], self.own[rows], self.passing[rows])

    def scaled(self, root: Array) -> Rest:
        """With the samples' weights changed, their roots (n, 1, 1)."""
        return Rest(self.path, self.row, root * self.own, root * self.passing)

    @cached_property
    def _blocks(self) -> tuple[tuple[slice, Array, Array, Array], ...]:
        """Of paths in a row where their coordinates are, B (3 n, r), and l (r,) and Q (r, r)."""
        blocks = []
        for begin, end in pairwise(_ends(self.row)):
            if self.path[begin] != AT_REST:
                columns = self._columns(slice(begin, end))
                values, axes = np.linalg.eigh(columns.T @ columns)
                at = slice(3 * begin, 3 * end)
                blocks.append((at, columns, np.clip(values, _LEAST, None), axes))
        return tuple(blocks)

    def _columns(self, rows: slice) -> Array:
        """B of paths in a row, (3 n, r)."""
        own, passing, ends = self.own[rows], self.passing[rows], _ends(self.path[rows])
        size = own.shape[-1]
        columns = [own]
        for begin, end in pairwise(ends):
            alone = np.zeros((len(own), 3, 2 * size))
            alone[begin:end, :, :size] = own[begin:end]
            alone[begin:end, :, size:] = passing[begin:end]
            columns.append(alone if len(ends) > 2 else passing)
        return np.concatenate(columns, axis=-1).reshape(3 * len(own), -1)

    def _less(self, x: Array, share: Callable[[Array], Array]) -> Array:
        """x - B Q diag(share(l)) Q^T B^T x of columns (3 n, k)."""
        result = x.copy()
        for at, own, values, axes in self._blocks:
            seen = axes.T @ (own.T @ x[at])
            result[at] -= own @ (axes @ (share(values)[:, None] * seen))
        return result

    def half(self, x: Array) -> Array:
        """C^(-1/2) x of columns (3 n, k)."""
        return self._less(x, lambda values: (1 - 1 / np.sqrt(1 + values)) / values)

    def without(self, x: Array) -> Array:
        """C^-1 x: columns (3 n, k) less their most likely rest errors."""
        return self._less(x, lambda values: 1 / (1 + values))

    @property
    def degrees(self) -> float:
        """Degrees of freedom that the rest errors take."""
        return float(sum(np.sum(values / (1 + values)) for _, _, values, _ in self._blocks))

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """What chance makes of them, (3 n, count)."""
        drawn = np.zeros((3 * len(self.path), count))
        for at, own, _, _ in self._blocks:
            drawn[at] = own @ rng.standard_normal((own.shape[1], count))
        return drawn


def _ends(number: Index) -> list[int]:
    """Where one run of equal numbers ends and the next begins."""
    n = len(number)
    return [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), n] if n else []


def _rows(path: Index, at: Conditions) -> Index:
    """Number of each sample's paths in a row, (n,)."""
    pause = np.diff(at.time, prepend=at.time[:1])
    away = np.abs(np.diff(at.joint, axis=0, prepend=at.joint[:1])).max(axis=1, initial=0.0)
    resting = (path == AT_REST) | (np.roll(path, 1) == AT_REST)
    other = np.diff(path, prepend=path[:1]) != 0
    apart = (np.abs(pause) > _PAUSE) | (away > _AWAY) | resting
    return np.cumsum(other & apart)
