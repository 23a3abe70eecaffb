"""A robot's drawing laid before the tracker as most rows of a table have it.

The drawing at the commanded joints, in the best frame before the tracker, misses measured points
by what a machine is off its drawing and by where its reflector really is: little beside the way
that the points lie apart. Numbers that are not what they are said to be are off by their own size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.geometry import Frame, align, carried_step
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
Way = tuple[Array, Array]  # joints (n, m) and measured points (n, 3) [m]

FEWEST = 6  # rows to lay a frame on
_TRIPLES = 200  # frames tried on three points each: that of the least median is believed, ...
_ROUNDS = 6  # ... and the frame and the reflector then laid anew so many times ...
_SETTLED = 0.99  # of the miss: a round that leaves more is the last
_CLOSE = 4.0  # ... on the rows that miss by less than so many medians
_THIN = 1e-3  # of three points' extent: nearer to one line they span no frame


@dataclass(frozen=True)
class Placed:
    """The drawing before the tracker; of several ways to read the rows, each row by its best."""

    robot: Robot
    frame: Frame  # T_tracker_base
    offset: Array  # (3,) [m] of the reflector
    typical: float  # [m] median miss; infinite where most rows are out of reach
    # [m] median distance of the points from their middle, or of the drawing's if that is less
    spread: float

    @property
    def share(self) -> float:
        """The median miss as a share of how far the points lie apart."""
        return self.typical / self.spread if self.spread else np.inf

    @property
    def close(self) -> float:
        """Rows that miss by less are where most are [m]."""
        return _CLOSE * self.typical

    @classmethod
    def on(cls, robot: Robot, ways: Sequence[Way]) -> Placed | None:
        """Laid on rows that may be read in several ways; None where nothing can be."""
        offset = robot.tracker.reflector_offset
        read = [_Read.of(robot, way) for way in ways]
        rng = np.random.default_rng(0)
        best, least = None, np.inf
        for rotation, shift in (f for r in read for f in r.frames(offset, rng)):
            missed = np.min([r.missed(rotation, shift, offset) for r in read], axis=0)
            typical = np.median(missed, axis=-1)
            k = int(np.argmin(typical))
            if typical[k] < least or best is None:
                best, least = Frame(rotation[k], shift[k]), float(typical[k])
        if best is None:
            return None
        placed = cls(robot, best, offset, 0.0, 0.0)._judged(read)
        for _ in range(_ROUNDS):
            before, placed = placed, placed._again(read)
            if placed.typical > _SETTLED * before.typical:
                break
        return placed

    def missed(self, way: Way) -> Array:
        """Distances between drawing and points, (n,) [m]; infinite out of reach or limits."""
        return _Read.of(self.robot, way).missed_in(self.frame, self.offset)

    def _judged(self, read: Sequence[_Read]) -> Placed:
        missed = np.array([r.missed_in(self.frame, self.offset) for r in read])
        point, centre = _chosen(read, missed, "point"), _chosen(read, missed, "centre")
        reached = np.isfinite(missed.min(axis=0))
        spread = min(_apart(point), _apart(centre[reached])) if reached.any() else 0.0
        return replace(self, typical=float(np.median(missed.min(axis=0))), spread=spread)

    def _again(self, read: Sequence[_Read]) -> Placed:
        """With the frame and the reflector laid on the rows that are close."""
        if not np.isfinite(self.typical):
            return self
        missed = np.array([r.missed_in(self.frame, self.offset) for r in read])
        close = missed.min(axis=0) <= self.close
        centre, rotation, point = (
            _chosen(read, missed, name)[close] for name in ("centre", "rotation", "point")
        )
        try:
            frame = align(centre + rotation @ self.offset, point)
            offset = self._offset(frame, centre, rotation, point)
            frame = align(centre + rotation @ offset, point)
        except DataError:
            return self
        found = replace(self, frame=frame, offset=offset)._judged(read)
        return found if found.typical < self.typical else self

    def _offset(self, frame: Frame, centre: Array, rotation: Array, point: Array) -> Array:
        """A better place of the reflector, (3,) [m], the frame being free to follow."""
        predicted = frame.apply(centre + rotation @ self.offset)
        tracker, weights = self.robot.tracker, np.ones(len(point))
        pull = (self.typical / tracker.reflector_offset_prior) ** 2
        toward = tracker.reflector_offset - self.offset
        about, own = predicted - predicted.mean(axis=0), frame.rotation @ rotation
        step = carried_step(own, about, point - predicted, weights, pull, toward)
        return np.asarray(self.offset + step)


@dataclass(frozen=True)
class _Read:
    """Rows read in one way: the drawing's poses and the measured points."""

    reached: NDArray[np.bool_]  # (n,) within reach and limits
    centre: Array  # (n, 3) [m] of the platform
    rotation: Array  # (n, 3, 3)
    point: Array  # (n, 3) [m] measured

    @classmethod
    def of(cls, robot: Robot, way: Way) -> _Read:
        joint, point = way
        model = robot.commanded
        inside = np.all((joint >= robot.joints.lower) & (joint <= robot.joints.upper), axis=1)
        x = np.full((len(joint), model.pose_size), np.nan)
        if inside.any():
            x[inside] = model.forward(joint[inside], model.parameters.nominal)
        reached = np.isfinite(x).all(axis=1)
        x = np.where(reached[:, None], x, 0.0)
        return cls(reached, model.position(x), model.rotation(x), point)

    def frames(self, offset: Array, rng: np.random.Generator) -> Iterator[tuple[Array, Array]]:
        """Rotations (k, 3, 3) and shifts (k, 3) of frames that three rows each span."""
        rows = np.flatnonzero(self.reached)
        if len(rows) < FEWEST:
            return
        three = rows[rng.random((_TRIPLES, len(rows))).argsort(axis=1)[:, :3]]
        place = (self.centre + self.rotation @ offset)[three]
        s, t = (p - p.mean(axis=1, keepdims=True) for p in (place, self.point[three]))
        good = _wide(s) & _wide(t)
        if not good.any():
            return
        u, _, vt = np.linalg.svd(np.swapaxes(t[good], 1, 2) @ s[good])
        u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]  # no reflection
        rotation = u @ vt
        middle = place[good].mean(axis=1)
        shift = self.point[three[good]].mean(axis=1) - np.einsum("kij,kj->ki", rotation, middle)
        yield rotation, shift

    def missed(self, rotation: Array, shift: Array, offset: Array) -> Array:
        """Distances in each of k frames, (k, n) [m]; infinite where it does not reach."""
        place = self.centre + self.rotation @ offset
        predicted = place @ np.swapaxes(rotation, -1, -2) + shift[..., None, :]
        missed = np.linalg.norm(predicted - self.point, axis=-1)
        return np.where(self.reached, missed, np.inf)

    def missed_in(self, frame: Frame, offset: Array) -> Array:
        """Distances in one frame, (n,) [m]."""
        return self.missed(frame.rotation, frame.translation, offset)


def _wide(three: Array) -> NDArray[np.bool_]:
    """Which of k times three points (k, 3, 3) are not on one line, (k,)."""
    a, b = three[:, 1] - three[:, 0], three[:, 2] - three[:, 0]
    area = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(area > _THIN * np.maximum(np.sum(a**2, axis=1), np.sum(b**2, axis=1)))


def _chosen(read: Sequence[_Read], missed: Array, name: str) -> Array:
    """What each row has in the way that misses least; missed (ways, n)."""
    values = np.array([getattr(r, name) for r in read])
    return np.asarray(values[missed.argmin(axis=0), np.arange(missed.shape[1])])


def _apart(place: Array) -> float:
    """How far places (n, 3) lie from their middle [m], whatever a few of them do."""
    return float(np.median(np.linalg.norm(place - np.median(place, axis=0), axis=1)))
