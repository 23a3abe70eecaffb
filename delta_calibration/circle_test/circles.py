"""Finds the circles in a session from the joint commands, and evaluates their roundness.

The terms are those of ISO 230-4 (circular tests for numerically controlled machine tools), each
about the centre of the least squares circle of the actual path:

    circular deviation G       largest less smallest radius of one actual path
    circular hysteresis H      largest radial difference of the paths of the two senses
    radial deviation F         actual less nominal radius, from the least to the greatest

All are of the readings as they are, with the tracker's noise; nothing is smoothed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ROUND = 5e-3  # share of the radius by which a commanded path may deviate from a circle
_TURN = np.radians(340.0)  # least angle of a circle
_GAP = np.radians(20.0)  # largest angle between two readings
_STEADY = 0.1  # share of the feed by which it may vary
_FEWEST = 24  # readings
_ITERATIONS = 4
_SQUARE = np.cos(np.radians(5.0))  # a plane within 5 degrees of two axes is named by them
_GRID = 720  # directions in which the two senses are compared
_SMALLEST = 1e-3  # [m] radius


@dataclass(frozen=True)
class Circle:
    """A commanded circle, and the readings on it."""

    rows: Index  # (n,) of the survey's readings in motion
    centre: Array  # (3,) [m] in the base
    axes: Array  # (2, 3) unit vectors in its plane, anticlockwise about the normal
    radius: float  # [m]
    angle: Array  # (n,) [rad] from the first axis, rising or falling
    feed: float  # [m/s]

    @property
    def anticlockwise(self) -> bool:
        """Whether the sense is anticlockwise, looking against the normal.

        The largest component of the normal is positive.
        """
        return bool(self.angle[-1] > self.angle[0])

    @property
    def sense(self) -> str:
        """Name of the sense in ISO 230-4."""
        return "anticlockwise" if self.anticlockwise else "clockwise"

    @cached_property
    def normal(self) -> Array:
        """Unit normal of its plane, (3,)."""
        return np.cross(*self.axes)

    @property
    def plane(self) -> str:
        """Name of the plane: `xy`, `yz`, `zx`; else its normal in words."""
        k = int(np.argmax(np.abs(self.normal)))
        if self.normal[k] >= _SQUARE:
            return ("yz", "zx", "xy")[k]
        return "normal " + " ".join(f"{v:.2f}" for v in self.normal)

    def take(self, kept: NDArray[np.bool_]) -> Circle:
        """The circle with some of its readings only; `kept` (n,)."""
        return replace(self, rows=self.rows[kept], angle=self.angle[kept])

    def radial(self, off: Array) -> Array:
        """Actual radius about the least squares centre less the nominal radius, (n,) [m].

        Args:
            off: actual less commanded points, in the base frame, (n, 3) [m].
        """
        return radii(self.points(off)) - self.radius

    def points(self, off: Array) -> Array:
        """Actual points in the plane, about the nominal centre, (n, 2) [m]."""
        out = np.stack([np.cos(self.angle), np.sin(self.angle)], axis=1)
        return np.asarray(self.radius * out + off @ self.axes.T)


def circular_deviation(radial: Array) -> float:
    """G of one path [m]: the range of its radii, (n,) [m]."""
    return float(np.ptp(radial))


def circular_hysteresis(one: Circle, off: Array, other: Circle, off_other: Array) -> float:
    """H of two paths on one circle [m]; both about their common least squares centre.

    Args:
        one: the circle in one sense.
        off: actual less commanded points of `one`, (n, 3) [m].
        other: the circle in the other sense.
        off_other: actual less commanded points of `other`, (k, 3) [m].
    """
    here, there = one.points(off), other.points(off_other)
    centre = _centre(np.concatenate([here, there]))
    grid = np.linspace(-np.pi, np.pi, _GRID, endpoint=False)
    both = [_at(grid, *_polar(points - centre)) for points in (here, there)]
    return float(np.abs(both[0] - both[1]).max())


def radii(points: Array) -> Array:
    """Distances from the centre of the least squares circle of points (n, 2), (n,) [m]."""
    return np.asarray(np.linalg.norm(points - _centre(points), axis=1))


def find_circles(time: Array, tool: Array, path: Index) -> tuple[Circle, ...]:
    """Find the circles among the paths of a session, in order of time.

    Only the part with steady feed is used, and from its middle at most one turn: acceleration and
    braking are left out.

    Args:
        time: of the readings, (n,) [s].
        tool: tool points of the nominal machine at the commanded joints, (n, 3) [m].
        path: number of the path that each reading belongs to, (n,).
    """
    numbers = np.unique(path)
    each = (_circle(time, tool, np.flatnonzero(path == number)) for number in numbers)
    return tuple(circle for circle in each if circle is not None)


def pairs(circles: Sequence[Circle]) -> Iterator[tuple[int, int]]:
    """Yield pairs of the same circle in both senses, by number; each circle in at most one."""
    open_ = list(range(len(circles)))
    while open_:
        i = open_.pop(0)
        back = next((j for j in open_ if _other_sense(circles[i], circles[j])), None)
        if back is not None:
            open_.remove(back)
            yield i, back


def _other_sense(one: Circle, other: Circle) -> bool:
    return _same_way(one, other) and one.anticlockwise != other.anticlockwise


def _same_way(one: Circle, other: Circle) -> bool:
    apart = np.linalg.norm(one.centre - other.centre) + abs(one.radius - other.radius)
    near = apart < 2 * _ROUND * one.radius and one.normal @ other.normal > _SQUARE
    return bool(near and abs(one.feed - other.feed) < 2 * _STEADY * one.feed)


def _circle(time: Array, tool: Array, rows: Index) -> Circle | None:
    """The circle of a path; None if the path is no circle."""
    if len(rows) < _FEWEST or not np.isfinite(tool[rows]).all():
        return None
    middle = tool[rows].mean(axis=0)
    axes, flat = _plane(tool[rows] - middle)
    in_plane = (tool[rows] - middle) @ axes.T
    centre = _centre(in_plane)
    radius = np.linalg.norm(in_plane - centre, axis=1)
    size = float(radius.mean())
    if size < _SMALLEST or max(flat, float(np.abs(radius - size).max())) > _ROUND * size:
        return None
    angle = np.unwrap(np.arctan2(*(in_plane - centre).T[::-1]))
    speed = np.gradient(angle, time[rows])
    usual = float(np.median(speed))
    steady = np.flatnonzero(np.abs(speed - usual) <= _STEADY * abs(usual))
    if len(steady) < _FEWEST:
        return None
    ends = angle[steady[[0, -1]]]
    turn = np.abs(angle - ends.mean()) <= min(np.pi, np.ptp(ends) / 2)
    steady = steady[turn[steady]]
    angle = angle[steady]
    if np.ptp(angle) < _TURN or np.abs(np.diff(angle)).max() > _GAP:
        return None
    place = middle + centre @ axes
    return Circle(rows[steady], place, axes, size, angle, abs(usual) * size)


def _plane(points: Array) -> tuple[Array, float]:
    """Axes (2, 3) of the plane through points (n, 3), and their largest distance from it [m].

    For a plane near two axes of the base, they are nearly those axes; the largest component of the
    normal is positive.
    """
    normal = np.linalg.svd(points, full_matrices=False)[2][2]
    k = int(np.argmax(np.abs(normal)))
    normal = normal * np.sign(normal[k])
    first = np.eye(3)[(k + 1) % 3]
    first = first - (first @ normal) * normal
    first = first / np.linalg.norm(first)
    axes = np.stack([first, np.cross(normal, first)])
    return axes, float(np.abs(points @ normal).max())


def _centre(points: Array) -> Array:
    """Centre of the circle through points (n, 2) by least squares of the radii, (2,)."""
    start = np.column_stack([2 * points, np.ones(len(points))])
    centre = np.linalg.lstsq(start, np.sum(points**2, axis=1), rcond=None)[0][:2]
    for _ in range(_ITERATIONS):
        out = points - centre
        radius = np.linalg.norm(out, axis=1)
        slope = np.column_stack([-out / radius[:, None], -np.ones(len(points))])
        centre = centre + np.linalg.lstsq(slope, radius.mean() - radius, rcond=None)[0][:2]
    return np.asarray(centre)


def _polar(points: Array) -> tuple[Array, Array]:
    """Angles in rising order, and radii, of points (n, 2)."""
    angle = np.arctan2(points[:, 1], points[:, 0])
    order = np.argsort(angle)
    return angle[order], np.linalg.norm(points[order], axis=1)


def _at(grid: Array, angle: Array, radius: Array) -> Array:
    return np.asarray(np.interp(grid, angle, radius, period=2 * np.pi))
