"""Robust fit of the nominal robot's frame and reflector offset to most rows of a table.

The residual of a row is the distance from the measured point to the nominal robot at the commanded
joints, in the best-fit tracker frame. It comes from the machine's deviation from nominal and from
the reflector offset, and is small compared with the spread of the points. Numbers with a wrong
meaning or unit have residuals as large as themselves.
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

FEWEST = 6  # rows to fit a frame to
_TRIPLES = 200  # frames through three rows each; that of the least median residual is refined
_ROUNDS = 6  # refinements of frame and reflector offset at most
_SETTLED = 0.99  # of the median residual: a refinement that leaves more is the last
_CLOSE = 4.0  # median residuals: a refinement uses the rows below
_THIN = 1e-3  # of the longer squared side of three points: least cross product of two sides


@dataclass(frozen=True)
class Placed:
    """Nominal robot in its best-fit tracker frame; each row is read in the way that fits best."""

    robot: Robot
    frame: Frame  # T_tracker_base
    offset: Array  # (3,) [m] of the reflector
    typical: float  # [m] median residual; infinite if most rows are out of reach
    # [m] median distance of the measured points from their median, or of the nominal ones if less
    spread: float

    @property
    def share(self) -> float:
        """Median residual over the spread of the points."""
        return self.typical / self.spread if self.spread else np.inf

    @property
    def close(self) -> float:
        """Largest residual of rows that agree with most others [m]."""
        return _CLOSE * self.typical

    @classmethod
    def on(cls, robot: Robot, ways: Sequence[Way]) -> Placed | None:
        """Fit to rows that may be read in several ways; None if no frame can be fitted."""
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
        """Residuals of rows, (n,) [m]; infinite out of reach or limits."""
        return _Read.of(self.robot, way).missed_in(self.frame, self.offset)

    def _judged(self, read: Sequence[_Read]) -> Placed:
        missed = np.array([r.missed_in(self.frame, self.offset) for r in read])
        point, centre = _chosen(read, missed, "point"), _chosen(read, missed, "centre")
        reached = np.isfinite(missed.min(axis=0))
        spread = min(_apart(point), _apart(centre[reached])) if reached.any() else 0.0
        return replace(self, typical=float(np.median(missed.min(axis=0))), spread=spread)

    def _again(self, read: Sequence[_Read]) -> Placed:
        """Refit frame and reflector offset to the close rows; unchanged if that is no better."""
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
        """Improved reflector offset, (3,) [m], with the frame free to adapt."""
        predicted = frame.apply(centre + rotation @ self.offset)
        tracker, weights = self.robot.tracker, np.ones(len(point))
        pull = (self.typical / tracker.reflector_offset_prior) ** 2
        toward = tracker.reflector_offset - self.offset
        about, own = predicted - predicted.mean(axis=0), frame.rotation @ rotation
        step = carried_step(own, about, point - predicted, weights, pull, toward)
        return np.asarray(self.offset + step)


@dataclass(frozen=True)
class _Read:
    """Rows read in one way: poses of the nominal robot and measured points."""

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
        """Rotations (k, 3, 3) and shifts (k, 3) [m] of frames fitted to three rows each."""
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
        """Residuals in each of k frames, (k, n) [m]; infinite if out of reach."""
        place = self.centre + self.rotation @ offset
        predicted = place @ np.swapaxes(rotation, -1, -2) + shift[..., None, :]
        missed = np.linalg.norm(predicted - self.point, axis=-1)
        return np.where(self.reached, missed, np.inf)

    def missed_in(self, frame: Frame, offset: Array) -> Array:
        """Residuals in one frame, (n,) [m]."""
        return self.missed(frame.rotation, frame.translation, offset)


def _wide(three: Array) -> NDArray[np.bool_]:
    """Mask (k,) of the triples of points (k, 3, 3) that are not collinear."""
    a, b = three[:, 1] - three[:, 0], three[:, 2] - three[:, 0]
    area = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(area > _THIN * np.maximum(np.sum(a**2, axis=1), np.sum(b**2, axis=1)))


def _chosen(read: Sequence[_Read], missed: Array, name: str) -> Array:
    """Attribute `name` of each row in the reading of least residual; missed (ways, n) [m]."""
    values = np.array([getattr(r, name) for r in read])
    return np.asarray(values[missed.argmin(axis=0), np.arange(missed.shape[1])])


def _apart(place: Array) -> float:
    """Median distance [m] of places (n, 3) from their median, robust to outliers."""
    return float(np.median(np.linalg.norm(place - np.median(place, axis=0), axis=1)))
