"""Motion of the joints: velocity, acceleration, direction and travel since the last reversal.

A joint has reversed when it has come back by more than `TURNED` times the mechanism's joint size
from the farthest point of its last stroke, so that encoder noise is not taken for a reversal.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TURNED = 200e-6  # [rad of a Delta]
_GAP = 0.25  # [s] pause between samples across which no velocity is computed
_SMOOTH = 0.1  # [s] window of the fits that give velocities, if samples are dense
_FEWEST = 5  # samples in the window
_BURST = 0.2  # of the median step: samples closer than this are a burst
_RIDGE = 1e-12  # regularization where the samples do not determine a quartic
_AT_A_TIME = 4096  # samples fitted at once


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
        """Velocity at the samples, (n, m) [rad/s]."""
        return self._derived[0]

    @property
    def acceleration(self) -> Array:
        """Acceleration at the samples, (n, m) [rad/s^2]."""
        return self._derived[1]

    @property
    def direction(self) -> Array:
        """Sign of the last motion at the samples, (n, m): -1, 0 (unknown) or 1."""
        return self._stroked[0]

    @property
    def travel(self) -> Array:
        """Distance from the last reversal, (n, m) [rad]; infinite before the first."""
        return self._stroked[1]

    def at(self, time: Array) -> tuple[Array, Array, Array, Array]:
        """Velocity, acceleration, direction and travel at other times, each (k, m)."""
        last = self._last(time)
        near = np.clip(np.searchsorted(self.time, time), 0, len(self.time) - 1)
        near = np.where(time - self.time[last] <= self.time[near] - time, last, near)
        since = (time - self.time[near])[:, None]
        acceleration = self.acceleration[near]
        gained = np.where(np.abs(since) <= _GAP, since, 0.0) * acceleration
        return self.velocity[near] + gained, acceleration, *self.sides(time)

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
    """Return the motion of joints (n, m) [rad] at increasing times (n,) [s].

    Args:
        time: of the samples.
        joint: coordinates at these times, in the joints' unit.
        joint_size: displacement, in the joints' unit, that corresponds to 1 rad of a Delta.
    """
    return Motion(time, joint, joint_size)


def largest_around(value: Array, around: int) -> Array:
    """Running maximum of values (n,), over `around` values before and after each, (n,)."""
    wide = np.pad(value, around, mode="edge")
    return np.asarray(sliding_window_view(wide, 2 * around + 1).max(axis=1))


def _derivatives(time: Array, joint: Array) -> tuple[Array, Array]:
    """Velocity and acceleration of one stretch, by quartics over unevenly spaced neighbours.

    A parabola would give half a percent too little on a circle sampled ten times a second.
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
    """Samples that do not follow in a burst; delayed messages arrive in bursts."""
    if (np.diff(time) >= least).all():
        return np.arange(len(time))
    kept, last = [], -np.inf
    for row, moment in enumerate(time.tolist()):
        if moment - last >= least:
            kept.append(row)
            last = moment
    return np.array(kept)


def _fitted(time: Array, joint: Array, rows: Index, near: Index) -> tuple[Array, Array]:
    """First and second derivative at rows (k,) of polynomials fitted to neighbours (k, w)."""
    apart = time[near] - time[rows, None]
    span = np.abs(apart).max(axis=1, keepdims=True)
    powers = (apart / span)[..., None] ** np.arange(min(5, near.shape[1]))
    across = np.swapaxes(powers, 1, 2)
    normal = across @ powers + _RIDGE * np.eye(powers.shape[2])
    terms = np.linalg.solve(normal, across @ (joint[near] - joint[rows, None]))
    return terms[:, 1] / span, 2 * terms[:, 2] / span**2


def _strokes(angle: Array, least: float) -> tuple[Array, Array]:
    """Direction and travel of one joint, each (n,); a reversal is a way back over `least`.

    A reversal is detected late; all samples after the farthest point belong to the new stroke.
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
    """Direction of a joint's motion and its start: the state on which backlash depends."""

    farthest: float  # [rad] farthest point of the stroke
    direction: float = 0.0
    turn: float = np.nan  # [rad] start of the stroke; NaN before the first reversal
    least: float = TURNED  # [rad] way back from which it is a reversal

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
        """Distance of the joint from its last reversal [rad]; infinite before the first."""
        return abs(angle - self.turn) if np.isfinite(self.turn) else np.inf
