"""Where the joints came to rest before a motion: an error that goes along with all of it.

A motion's readings share how far off its command each joint was when it began, u with spread s,
which along the motion may pass into what it ends with. Path by path their covariance is

    C = 1 + B B^T        B: whitened columns of s u and s u' of the path, (3 n, 2 m)

Paths have nothing to do with one another: C is made of a block each, and its inverse root

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

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AT_REST = -1  # path of the poses
_LEAST = 1e-12


@dataclass(frozen=True)
class Rest:
    """Rest errors of the paths among n samples; a path's samples follow each other."""

    path: Index  # (n,) number of the path, `AT_REST` for poses
    columns: Array  # (n, 3, r) whitened, in units of their spread; of no matter for poses

    @classmethod
    def of(cls, path: Index, by_joints: Array) -> Rest:
        """Of the paths of samples.

        Args:
            path: number of each sample's path (n,), `AT_REST` for poses.
            by_joints: whitened d(reading) by the joints' rest errors in their spread, (n, 3, m).
        """
        course = np.zeros(len(path))
        for number in np.unique(path[path != AT_REST]):
            on = path == number
            course[on] = np.linspace(-0.5, 0.5, int(on.sum()))
        passing = np.sqrt(2) * course[:, None, None] * by_joints  # two draws differ by so much
        return cls(path, np.concatenate([by_joints, passing], axis=-1))

    def take(self, rows: NDArray[np.intp]) -> Rest:
        """Of some of the samples."""
        return Rest(self.path[rows], self.columns[rows])

    def scaled(self, root: Array) -> Rest:
        """With the samples' weights changed, their roots (n, 1, 1)."""
        return Rest(self.path, root * self.columns)

    @cached_property
    def _blocks(self) -> tuple[tuple[slice, Array, Array, Array], ...]:
        """Of each path where its coordinates are, B (3 n, r), and l (r,) and Q (r, r)."""
        blocks = []
        for begin, end in pairwise(self._ends):
            if self.path[begin] != AT_REST:
                own = self.columns[begin:end].reshape(3 * (end - begin), -1)
                values, axes = np.linalg.eigh(own.T @ own)
                at = slice(3 * begin, 3 * end)
                blocks.append((at, own, np.clip(values, _LEAST, None), axes))
        return tuple(blocks)

    @property
    def _ends(self) -> list[int]:
        """Where one path ends and the next begins."""
        n = len(self.path)
        return [0, *(np.flatnonzero(np.diff(self.path)) + 1).tolist(), n] if n else []

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
