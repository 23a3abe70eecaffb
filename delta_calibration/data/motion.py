"""How the joints moved: speed, acceleration, and which way each has gone since it last turned.

Directions follow the largest excursion: a joint has turned round when it has come back by more
than `TURNED` times the mechanism's joint size from the farthest point of its last stroke, so that
the noise of an encoder does not turn it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TURNED = 200e-6  # [rad of a Delta]
_GAP = 0.25  # [s] across a longer pause there is no speed
_SMOOTH = 0.1  # [s] over which speeds are taken where samples are denser
_FEWEST = 5  # samples
_BURST = 0.2  # of the usual step
_RIDGE = 1e-12  # where the samples in a row do not set a quartic, a lower curve is taken
_AT_A_TIME = 4096


@dataclass(frozen=True)
class Motion:
    """Motion of the joints at the n samples of a stream, in the order of time.

    Speeds and strokes are computed when first asked for: poses at rest need no speed.
    """

    time: Array  # (n,) [s]
    joint: Array  # (n, m) [rad]
    joint_size: float

    @property
    def velocity(self) -> Array:
        """(n, m) [rad/s]."""
        return self._derived[0]

    @property
    def acceleration(self) -> Array:
        """(n, m) [rad/s^2]."""
        return self._derived[1]

    @property
    def direction(self) -> Array:
        """(n, m) -1, 0, 1."""
        return self._stroked[0]

    @property
    def travel(self) -> Array:
        """(n, m) [rad] since the last turn, infinite before the first."""
        return self._stroked[1]

    def at(self, time: Array) -> tuple[Array, Array, Array, Array]:
        """Velocity, acceleration, direction and travel at other times, each (k, m)."""
        last = self._last(time)
        near = np.clip(np.searchsorted(self.time, time), 0, len(self.time) - 1)
        near = np.where(time - self.time[last] <= self.time[near] - time, last, near)
        return self.velocity[near], self.acceleration[near], *self.sides(time)

    def sides(self, time: Array) -> tuple[Array, Array]:
        """Direction and travel of the joints at other times, each (k, m)."""
        last = self._last(time)
        return self.direction[last], self.travel[last]

    def _last(self, time: Array) -> Index:
        return np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, None)

    @cached_property
    def _derived(self) -> tuple[Array, Array]:
        velocity, acceleration = np.zeros_like(self.joint), np.zeros_like(self.joint)
        edges = np.r_[0, np.flatnonzero(np.diff(self.time) > _GAP) + 1, len(self.time)]
        for begin, end in pairwise(edges):
            if end - begin >= 3:
                part = slice(begin, end)
                found = _derivatives(self.time[part], self.joint[part])
                velocity[part], acceleration[part] = found
        return velocity, acceleration

    @cached_property
    def _stroked(self) -> tuple[Array, Array]:
        strokes = [_strokes(angle, TURNED * self.joint_size) for angle in self.joint.T]
        direction, travel = (np.column_stack(columns) for columns in zip(*strokes, strict=True))
        return direction, travel


def motion_of(time: Array, joint: Array, joint_size: float = 1.0) -> Motion:
    """Motion of joints (n, m) [rad] at rising times (n,) [s].

    Args:
        time: of the samples.
        joint: coordinates at these times, in the joints' unit.
        joint_size: of the joints' unit, that does what one radian does on a Delta.
    """
    return Motion(time, joint, joint_size)


def largest_around(value: Array, around: int) -> Array:
    """Largest of each value (n,) and of as many as `around` before and behind it, (n,)."""
    wide = np.pad(value, around, mode="edge")
    return np.asarray(sliding_window_view(wide, 2 * around + 1).max(axis=1))


def _derivatives(time: Array, joint: Array) -> tuple[Array, Array]:
    """Speed and acceleration of one stretch, by a quartic over the neighbours, whenever they came.

    A parabola would be half a percent short on a circle read ten times a second.
    """
    step = float(np.median(np.diff(time)))
    kept = _apart(time, _BURST * step)
    of, n = np.searchsorted(kept, np.arange(len(time)), side="right") - 1, len(kept)
    if n < 3:
        return np.zeros_like(joint), np.zeros_like(joint)
    width = min(max(_FEWEST, 2 * int(_SMOOTH / step / 2) + 1), n)
    begin = np.clip(np.arange(n) - width // 2, 0, n - width)
    parts = [
        _fitted(time[kept], joint[kept], rows, begin[rows, None] + np.arange(width))
        for rows in np.array_split(np.arange(n), n // _AT_A_TIME + 1)
    ]
    first, second = (np.concatenate(part)[of] for part in zip(*parts, strict=True))
    return first, second


def _apart(time: Array, least: float) -> Index:
    """Samples that are not in a burst with the one before, as what was held up is sent in."""
    if (np.diff(time) >= least).all():
        return np.arange(len(time))
    kept, last = [], -np.inf
    for row, moment in enumerate(time.tolist()):
        if moment - last >= least:
            kept.append(row)
            last = moment
    return np.array(kept)


def _fitted(time: Array, joint: Array, rows: Index, near: Index) -> tuple[Array, Array]:
    """First and second derivative at some rows (k,) of polynomials through those near, (k, w)."""
    apart = time[near] - time[rows, None]
    span = np.abs(apart).max(axis=1, keepdims=True)
    powers = (apart / span)[..., None] ** np.arange(min(5, near.shape[1]))
    across = np.swapaxes(powers, 1, 2)
    normal = across @ powers + _RIDGE * np.eye(powers.shape[2])
    terms = np.linalg.solve(normal, across @ (joint[near] - joint[rows, None]))
    return terms[:, 1] / span, 2 * terms[:, 2] / span**2


def _strokes(angle: Array, least: float) -> tuple[Array, Array]:
    """Direction and travel of one joint, each (n,), which turns by coming back more than `least`.

    A turn shows only when the joint has come back far enough; all since then belongs to it.
    """
    changed = np.flatnonzero(np.diff(angle, prepend=np.nan) != 0)
    went = angle[changed]
    stroke, turned = Stroke(float(went[0]), least=least), 0  # row after the farthest point
    begins, strokes = [0], [stroke]
    for row, value in enumerate(went.tolist()):
        before, stroke = stroke, stroke.moved(value)
        if stroke.direction != before.direction:
            begins.append(turned if before.direction else row)
            strokes.append(stroke)
        if stroke.farthest == value:
            turned = row + 1
    rows = np.diff([*begins, len(went)])
    direction = np.repeat([own.direction for own in strokes], rows)
    turn = np.repeat([own.turn for own in strokes], rows)
    travel = np.where(np.isfinite(turn), np.abs(went - turn), np.inf)
    held = np.diff(np.append(changed, len(angle)))
    return np.repeat(direction, held), np.repeat(travel, held)


@dataclass(frozen=True)
class Stroke:
    """Which way a joint goes and from where; the state that play depends on."""

    farthest: float  # [rad] the stroke has come
    direction: float = 0.0
    turn: float = np.nan  # [rad] where it began; NaN before the first turn
    least: float = TURNED  # [rad] of a way back that is a turn

    def moved(self, angle: float) -> Stroke:
        """The stroke after the joint has come to `angle` [rad]."""
        if self.direction == 0.0:
            gone = angle - self.farthest
            return self if abs(gone) <= self.least else self._gone(angle, np.sign(gone), np.nan)
        if self.direction * (angle - self.farthest) >= 0:
            return self._gone(angle, self.direction, self.turn)
        if self.direction * (self.farthest - angle) <= self.least:
            return self
        return self._gone(angle, -self.direction, self.farthest)

    def _gone(self, farthest: float, direction: float, turn: float) -> Stroke:
        return Stroke(farthest, float(direction), turn, self.least)

    def travel(self, angle: float) -> float:
        """How far the joint is from where it last turned [rad]; infinite before."""
        return abs(angle - self.turn) if np.isfinite(self.turn) else np.inf
