"""Commanded path with stations at equal arc lengths, and deviations of attained paths from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from delta_calibration.errors import DataError, InputError

Array = NDArray[np.float64]

FINE = 20  # straight pieces between stations, on which samples are projected
LONGEST_HOLE = 10.0  # spacings of stations; a longer gap between samples is a loss of data


@dataclass(frozen=True)
class Path:
    """Stations along a path; the last station of a closed path is its first.

    The parts of a path that crosses or retraces itself cannot be told apart: evaluate each alone.
    """

    stations: Array  # (s, 3) [m]
    fine: Array  # (FINE (s - 1) + 1, 3) [m] the command, interpolated at equal arc lengths
    closed: bool

    @classmethod
    def through(cls, command: Array, count: int) -> Path:
        """Return the path through commanded points, `count` stations from end to end.

        It is closed if it ends, within a hundredth of a spacing, where it began.

        Args:
            command: Points (k, 3) [m], in order; repeated points are allowed.
            count: Number of stations s, at least 5.

        Raises:
            InputError: if the command has no length or turns back on itself.
        """
        along = _arc(command)
        if not along[-1] > 0.0:
            raise InputError("the command does not move; a path needs a length")
        at = np.linspace(0.0, along[-1], count)
        apart = float(np.linalg.norm(command[0] - command[-1]))
        finely = np.linspace(0.0, along[-1], FINE * (count - 1) + 1)
        stations, fine = (_interpolated(a, along, command) for a in (at, finely))
        path = cls(stations, fine, closed=apart < 0.01 * at[1])
        if np.min(np.linalg.norm(path._chords(), axis=1)) < 0.6 * at[1]:  # over 106 degrees
            raise InputError("command turns back on itself; such a path has to be judged in parts")
        return path

    def deviation(self, x: Array, name: str = "attempt") -> Array:
        """Return the deviation of an attempt at each station, normal to the path; (s, 3) [m].

        Each sample is projected on the path, which gives its arc length and its offset; offsets
        are interpolated to the stations by arc length. Offsets, not positions, are interpolated:
        the straight line between two samples on a bend would cut the corner. The times of the
        samples do not matter.

        Args:
            x: Samples of the attempt (k, 3) [m].
            name: Name of the attempt in messages.

        Raises:
            DataError: if the attempt leaves out a part of the path.
        """
        arc = FINE * np.arange(len(self.stations)) * _arc(self.fine)[-1] / (len(self.fine) - 1)
        along, off = self._offsets(x)
        order = np.argsort(along, kind="stable")
        along, off = along[order], off[order]
        if self.closed:  # repeat the last sample before the first, and the first after the last
            along = np.concatenate([along[-1:] - arc[-1], along, along[:1] + arc[-1]])
            off = np.concatenate([off[-1:], off, off[:1]])
        _require_whole(along, arc, name)
        off = _interpolated(arc, along, off)
        tangent = self._tangents()
        return np.asarray(off - np.sum(off * tangent, axis=1, keepdims=True) * tangent)

    def _offsets(self, x: Array) -> tuple[Array, Array]:
        """Return arc lengths (k,) [m] and offsets (k, 3) [m] of the samples from the path.

        An open path is extended straight by one spacing at both ends; samples beyond are left out.
        """
        arc = _arc(self.fine)
        start, run = self.fine[:-1], np.diff(self.fine, axis=0)
        low, high = np.zeros(len(run)), np.ones(len(run))
        if not self.closed:
            low[0], high[-1] = -FINE, 1.0 + FINE
        vertex = cKDTree(self.fine).query(x)[1]  # pieces are equal: the nearest adjoins its vertex
        pieces = np.clip(vertex[:, None] + [-1, 0], 0, len(run) - 1)
        t = np.sum((x[:, None] - start[pieces]) * run[pieces], axis=-1)
        t = np.clip(t / np.sum(run[pieces] ** 2, axis=-1), low[pieces], high[pieces])
        foot = start[pieces] + t[..., None] * run[pieces]
        rows = np.arange(len(x))
        nearer = np.argmin(np.linalg.norm(x[:, None] - foot, axis=-1), axis=1)
        t, foot, nearest = t[rows, nearer], foot[rows, nearer], pieces[rows, nearer]
        inside = (t > -FINE) & (t < 1.0 + FINE)
        return (arc[nearest] + t * np.diff(arc)[nearest])[inside], (x - foot)[inside]

    def _tangents(self) -> Array:
        """Return the unit direction of the path at each station (s, 3)."""
        chords = self._chords()
        return np.asarray(chords / np.linalg.norm(chords, axis=1, keepdims=True))

    def _chords(self) -> Array:
        """Return half of the chord between the neighbours, a step at open ends; (s, 3) [m]."""
        chords = np.gradient(self.stations, axis=0)
        if self.closed:
            chords[[0, -1]] = 0.5 * (self.stations[1] - self.stations[-2])
        return np.asarray(chords)


def _require_whole(along: Array, arc: Array, name: str) -> None:
    """Raise DataError unless samples at `along` go from end to end without a long gap."""
    step = float(arc[1])
    if not len(along) or along[0] > step or along[-1] < arc[-1] - step:
        raise DataError(f"{name} does not go from end to end of the command path")
    hole = float(np.max(np.diff(along), initial=0.0))
    if hole > LONGEST_HOLE * step:
        raise DataError(
            f"{name} has no sample over {hole:.4g} m of the path; "
            f"at most {LONGEST_HOLE * step:.4g} m is allowed"
        )


def _arc(points: Array) -> Array:
    """Return the length (k,) [m] along points (k, 3) [m] from the first."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _interpolated(at: Array, along: Array, points: Array) -> Array:
    """Return points (k, 3) at arc lengths `along` (k,), interpolated to `at` (s,); (s, 3)."""
    return np.stack([np.interp(at, along, column) for column in points.T], axis=1)
