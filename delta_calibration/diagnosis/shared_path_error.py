"""Rest errors of the joints before a motion, which all readings of the motion share.

The rest error u of a joint, with standard deviation s, is its distance from the command when a
motion began. Along the motion it may change into the rest error with which the motion ends. It may
or may not be kept if the machine reverses at the end of a path, and as long as motion follows
motion without a stop. So each path has an error of its own, shares one with the paths in its row
(each begins where the last has ended), and one with its whole episode. Their covariance is

    C = 1 + B B^T        B: whitened columns of s u, one for each of these, (d n, r)

Episodes are independent: C is block diagonal, one block for each, and inner products

    a^T C^-1 b = a^T b - s(a)^T s(b)        s(x) = (1 + L)^(-1/2) Q^T B^T x,    B^T B = Q L Q^T

cost time in proportion to the number of readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.columns import Columns, Plain
from delta_calibration.diagnosis.narrow import FEW, seen
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AT_REST = -1  # path number of the poses
_PAUSE, _AWAY = 5.0, 0.02  # [s], [rad of a Delta] at most between paths in a row
_LONG = 120.0  # [s] at most between motions of an episode


@dataclass(frozen=True)
class SharedPathError:
    """Covariance of the rest errors of the paths among n samples; a path's are contiguous."""

    path: Index  # (n,) number of the path, `AT_REST` for poses
    row: Index  # (n,) number of the row of paths
    episode: Index  # (n,) number of the episode: motions without a stop between them
    own: Array  # (n, d, m) whitened columns of a constant error of size s; unused for poses
    passing: Array  # (n, d, m) of an error that changes linearly from start to end of the path

    @classmethod
    def of(
        cls, path: Index, at: Conditions, by_joints: Array, joint_size: float = 1.0
    ) -> SharedPathError:
        """Covariance for samples on paths and poses.

        Args:
            path: number of each sample's path (n,), `AT_REST` for poses.
            at: joint angles and times.
            by_joints: whitened d(reading) by the joints' rest errors in units of s, (n, d, m).
            joint_size: joint motion, in the joints' unit, equivalent to one radian on a Delta.
        """
        course = np.zeros(len(path))
        for number in np.unique(path[path != AT_REST]):
            on = path == number
            course[on] = np.linspace(-0.5, 0.5, int(on.sum()))
        # two independent rest errors differ by sqrt(2) standard deviations
        passing = np.sqrt(2) * course[:, None, None] * by_joints
        return cls(path, _rows(path, at, joint_size), _episodes(path, at), by_joints, passing)

    def take(self, rows: NDArray[np.intp]) -> SharedPathError:
        """The covariance of some of the samples."""
        return SharedPathError(
            self.path[rows], self.row[rows], self.episode[rows], self.own[rows], self.passing[rows]
        )

    def scaled(self, root: Array) -> SharedPathError:
        """The covariance with the samples' weights changed, their roots (n, 1, 1)."""
        return SharedPathError(
            self.path, self.row, self.episode, root * self.own, root * self.passing
        )

    @cached_property
    def _blocks(self) -> tuple[tuple[slice, Array, Array], ...]:
        """Of each episode its slice of coordinates, B (d n, r), and S (r, r): s(x) = S B^T x."""
        blocks, d = [], self.own.shape[1]
        levels = _levels(self.path, self.row, self.episode)
        for begin, end in pairwise(levels[-1].tolist()):
            if self.path[begin] != AT_REST:
                columns = self._columns(begin, end, levels)
                values, axes = np.linalg.eigh(columns.T @ columns)
                weak = 1 / np.sqrt(1 + np.maximum(values, 0.0))
                blocks.append((slice(d * begin, d * end), columns, weak[:, None] * axes.T))
        return tuple(blocks)

    def _columns(self, begin: int, end: int, levels: Sequence[Index]) -> Array:
        """Columns B of an episode, (d n, r): each error is zero but in its run of samples.

        Args:
            begin: first sample of the episode.
            end: behind its last one.
            levels: where the runs of paths, rows and episodes end, after a leading 0.
        """
        paths = _runs(levels[0], begin, end)
        runs = [(self.own, run) for run in paths] + [(self.passing, run) for run in paths]
        for parts, wholes in pairwise(levels):
            each = _runs(wholes, begin, end)
            runs += [(self.own, run) for run in each if len(_runs(parts, *run)) > 1]
        _, d, m = self.own.shape
        columns = np.zeros((end - begin, d, m * len(runs)))
        for k, (of, (start, stop)) in enumerate(runs):
            columns[start - begin : stop - begin, :, m * k : m * (k + 1)] = of[start:stop]
        return columns.reshape(d * (end - begin), -1)

    @cached_property
    def _together(self) -> tuple[Index, Array, Array]:
        """All blocks: of each first coordinate, one behind the last, and r; B and S, flattened."""
        spans = [(at.start, at.stop, own.shape[1]) for at, own, _ in self._blocks]
        own = np.concatenate([np.zeros(0), *(own.ravel() for _, own, _ in self._blocks)])
        root = np.concatenate([np.zeros(0), *(root.ravel() for _, _, root in self._blocks)])
        return np.array(spans, dtype=np.int64).reshape(-1, 3), own, root

    def seen(self, x: Array) -> Array:
        """Projection s(x) of columns (d n, k) onto the rest errors, (r, k)."""
        return self.seen_of(Plain(x))

    def seen_of(self, x: Columns) -> Array:
        """s(x) of columns that may be products, (r, k)."""
        if isinstance(x, Plain) and x.width <= FEW:
            return seen(np.ascontiguousarray(x.values), *self._together)
        every = zip(self.samples, self._blocks, strict=True)
        d = self.own.shape[1]
        parts = [root @ x.part(rows, d).along(own).T for rows, (_, own, root) in every]
        return np.concatenate([np.zeros((0, x.width)), *parts])

    @property
    def weak(self) -> Array:
        """1 / (1 + L), (r,): with it (C^-1 a)^T C^-1 b = a^T C^-1 b - s(a)^T weak s(b)."""
        parts = [np.sum(root**2, axis=1) for _, _, root in self._blocks]
        return np.concatenate([np.zeros(0), *parts])

    def taken(self, x: Columns) -> float:
        """Sum of squares of columns x less that of C^-1 x."""
        seen = self.seen_of(x)
        return float(np.sum((1 + self.weak[:, None]) * seen**2))

    @property
    def samples(self) -> tuple[slice, ...]:
        """Samples of each episode, in the order of the parts of `seen_by_sample`."""
        d = self.own.shape[1]
        return tuple(slice(at.start // d, at.stop // d) for at, _, _ in self._blocks)

    def seen_by_sample(self, m: Array) -> tuple[Array, ...]:
        """Contribution of each sample to s(m f) for any function f, (samples, r) by episode.

        Args:
            m: whitened derivative of the readings, (n, d).
        """
        parts, d = [], self.own.shape[1]
        for rows, (_, own, root) in zip(self.samples, self._blocks, strict=True):
            columns = own.reshape(-1, d, own.shape[1])
            parts.append(np.einsum("nc,ncr->nr", m[rows], columns) @ root.T)
        return tuple(parts)

    def inner(self, x: Array) -> Array:
        """x^T C^-1 x of columns (d n, k), (k, k)."""
        shared = self.seen(x)
        return np.asarray(x.T @ x - shared.T @ shared)

    def without(self, x: Array) -> Array:
        """C^-1 x: columns (d n, k) less their most likely rest errors."""
        result = x.copy()
        for at, own, root in self._blocks:
            result[at] -= own @ (root.T @ (root @ (own.T @ x[at])))
        return result

    @property
    def degrees(self) -> float:
        """Degrees of freedom that the rest errors take from the residuals."""
        return float(sum(np.sum((root @ own.T) ** 2) for _, own, root in self._blocks))

    def draw_into(self, drawn: Array, rng: np.random.Generator) -> None:
        """Add random rest errors to draws of noise, (d n, count), in place."""
        for at, own, _ in self._blocks:
            drawn[at] += own @ rng.standard_normal((own.shape[1], drawn.shape[1]))


def _levels(path: Index, row: Index, episode: Index) -> list[Index]:
    """Where the runs of paths, rows and episodes end, each after a leading 0."""
    new, ends = np.zeros(len(path), dtype=bool), []
    for level in (episode, row, path):  # where an episode ends, its last row and path do as well
        new[1:] |= np.diff(level) != 0
        ends.append(np.unique(np.r_[0, np.flatnonzero(new), len(path)]))
    return ends[::-1]


def _runs(ends: Index, begin: int, end: int) -> list[tuple[int, int]]:
    """Begin and end of each run between two samples at which runs begin and end."""
    first, last = np.searchsorted(ends, [begin, end])
    return list(pairwise(ends[first : last + 1].tolist()))


def _episodes(path: Index, at: Conditions) -> Index:
    """Number of each sample's episode, motions without a stop between them, (n,)."""
    stops = np.sort(at.time[path == AT_REST])
    before = np.searchsorted(stops, at.time)
    long = np.abs(np.diff(at.time, prepend=at.time[:1])) > _LONG
    other = np.diff(path, prepend=path[:1]) != 0
    resting = (path == AT_REST) | (np.roll(path, 1) == AT_REST)
    new = np.diff(before, prepend=before[:1]) != 0
    return np.cumsum(other & (resting | new | long))


def _rows(path: Index, at: Conditions, joint_size: float) -> Index:
    """Number of each sample's row of paths, (n,)."""
    pause = np.diff(at.time, prepend=at.time[:1])
    away = np.abs(np.diff(at.joint, axis=0, prepend=at.joint[:1])).max(axis=1, initial=0.0)
    resting = (path == AT_REST) | (np.roll(path, 1) == AT_REST)
    other = np.diff(path, prepend=path[:1]) != 0
    apart = (np.abs(pause) > _PAUSE) | (away > _AWAY * joint_size) | resting
    return np.cumsum(other & apart)
