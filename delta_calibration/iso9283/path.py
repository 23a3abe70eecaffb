"""A commanded path as stations at equal arc lengths, and what was attained laid over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError, InputError

Array = NDArray[np.float64]

LONGEST_HOLE = 10.0  # spacings of stations; where more is missing, data were lost


@dataclass(frozen=True)
class Path:
    """Stations along a path; a closed one has its first station again as its last.

    A path that crosses or retraces itself is not told apart from itself: judge it in parts.
    """

    stations: Array  # (s, 3) [m]
    closed: bool

    @classmethod
    def through(cls, command: Array, count: int) -> Path:
        """Return the path through commanded points, `count` stations from end to end.

        It is closed if it ends, within a hundredth of a spacing, where it began.

        Args:
            command: Points (k, 3) [m], in order; standing still in between does no harm.
            count: Number of stations s, at least 5.

        Raises:
            InputError: if the command has no length or turns back on itself.
        """
        along = _arc(command)
        if not along[-1] > 0.0:
            raise InputError("command stands still; a path has to have a length")
        at = np.linspace(0.0, along[-1], count)
        apart = float(np.linalg.norm(command[0] - command[-1]))
        path = cls(_interpolated(at, along, command), closed=apart < 0.01 * at[1])
        if np.min(np.linalg.norm(path._chords(), axis=1)) < 0.6 * at[1]:  # over 106 degrees
            raise InputError("command turns back on itself; such a path has to be judged in parts")
        return path

    def deviation(self, x: Array, name: str = "attempt") -> Array:
        """Return how far an attempt is off at each station, normal to the path; (s, 3) [m].

        Each sample is projected on the path, which tells how far along it is; by that length
        the attempt is interpolated to the stations. When each sample was taken does not matter.

        Args:
            x: Samples of the attempt (k, 3) [m].
            name: What to call it in messages.

        Raises:
            DataError: if the attempt leaves out a part of the path.
        """
        arc = _arc(self.stations)
        along, x = self._along(x, arc)
        order = np.argsort(along, kind="stable")
        along, x = along[order], x[order]
        if self.closed:  # the last sample comes again before the first, the first after the last
            along = np.concatenate([along[-1:] - arc[-1], along, along[:1] + arc[-1]])
            x = np.concatenate([x[-1:], x, x[:1]])
        _require_whole(along, arc, name)
        off = _interpolated(arc, along, x) - self.stations
        tangent = self._tangents()
        return np.asarray(off - np.sum(off * tangent, axis=1, keepdims=True) * tangent)

    def _along(self, x: Array, arc: Array) -> tuple[Array, Array]:
        """Return the arc lengths (k,) [m] of the samples on the path, and those samples.

        An open path goes on straight for one spacing at both ends; samples beyond are left out.
        """
        start, run = self.stations[:-1], np.diff(self.stations, axis=0)
        low, high = np.zeros(len(run)), np.ones(len(run))
        if not self.closed:
            low[0], high[-1] = -1.0, 2.0
        t = np.einsum("knc,nc->kn", x[:, None] - start, run) / np.sum(run**2, axis=1)
        t = np.clip(t, low, high)
        foot = start + t[..., None] * run
        nearest = np.argmin(np.linalg.norm(x[:, None] - foot, axis=-1), axis=1)
        t = t[np.arange(len(x)), nearest]
        inside = (t > -1.0) & (t < 2.0)
        return (arc[nearest] + t * np.diff(arc)[nearest])[inside], x[inside]

    def _tangents(self) -> Array:
        """Return the unit direction of the path at each station (s, 3)."""
        chords = self._chords()
        return np.asarray(chords / np.linalg.norm(chords, axis=1, keepdims=True))

    def _chords(self) -> Array:
        """Return half of what lies between each station's neighbours, (s, 3) [m]."""
        chords = np.gradient(self.stations, axis=0)
        if self.closed:
            chords[[0, -1]] = 0.5 * (self.stations[1] - self.stations[-2])
        return np.asarray(chords)


def _require_whole(along: Array, arc: Array, name: str) -> None:
    """Raise DataError unless samples at `along` go from end to end without a long hole."""
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
    """Return the points (k, 3) that stand at `along` (k,), interpolated to `at` (s,); (s, 3)."""
    return np.stack([np.interp(at, along, column) for column in points.T], axis=1)
