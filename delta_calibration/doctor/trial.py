"""Tries hypotheses of mistakes with the nominal robot in its best frame on a session's stops.

Single mistakes are tried first, then pairs of those without a parameter. A hypothesis is accepted
if it reduces the residual to a quarter or less, and to at most twice what tolerances explain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Session, TrackerStream
from delta_calibration.doctor import hypotheses, moves, robot_file
from delta_calibration.doctor.change import (
    TRACKER,
    Answer,
    Change,
    joint_streams,
    of_tracker,
)
from delta_calibration.doctor.placing import (
    Placed,
    expected,
    joints_and_points,
    place,
)
from delta_calibration.doctor.stops import SPARSE, stops_of, thinned
from delta_calibration.doctor.turns import DOUBTED, doubt, turn_misfit
from delta_calibration.documents import Document
from delta_calibration.lazy import cached_property
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

EXPLAINED = 2.0  # times what tolerances explain: largest residual of a session without a mistake
UNEXPLAINED = 4.0  # times what tolerances explain: from there on a mistake is certain
# Largest effect of tolerances as a share of the spread of the points (near a singularity the
# linear estimate is larger): for a hypothesis, and for the session as recorded.
_SHARE = 0.01, 0.05
_CLEARLY = 4.0  # least factor by which the residual must decrease
_ALIKE = 1.5  # times the smallest residual: hypotheses up to there are indistinguishable
_TRIED = 80  # stops
_GRID = 48
_SHIFTS = 8  # largest shift, in rows of a table, between joints and readings
_UPRIGHT = 0.9
_MIXED = 5.0  # ratio of extents that shows coordinates in two units; no workspace is so flat


@dataclass(frozen=True)
class Trial:
    """A session compared with the nominal robot.

    `session` is complete, with joints in the robot's order; `stops` are its stops.
    """

    session: Session
    robot: Robot
    stops: Session
    document: Document | None = None
    source: str = ""

    @cached_property
    def few(self) -> Session:
        """At most 80 of the stops, spread evenly over the session."""
        return thinned(self.stops, _TRIED)

    @cached_property
    def placed(self) -> Placed:
        """The nominal robot in its best frame."""
        return place(self.few, self.robot)

    @cached_property
    def tolerated(self) -> float:
        """Residual that the tolerances explain [m]."""
        own = _tolerated(self.placed, self.robot, self.few)
        return min(own, _SHARE[1] * _spread(self.placed))

    @property
    def misfit(self) -> float:
        """Ratio of the residual to what the tolerances explain."""
        return self.placed.typical / self.tolerated if self.placed.found else np.inf

    def left(self, change: Change) -> tuple[float, float]:
        """Median residual [m] with a mistake undone, and its ratio to what tolerances explain."""
        robot = change.robot or self.robot
        if change.mistake == "clock_offset":
            stops = stops_of(change.undo(self.session))
            stops = None if stops is None else thinned(stops, _TRIED)
        else:
            stops = change.undo(self.few)
        if stops is None:
            return np.inf, np.inf
        placed = place(stops, robot)
        if not placed.found:
            return np.inf, np.inf
        return placed.typical, placed.typical / min(
            _tolerated(placed, robot, stops), _SHARE[0] * _spread(placed)
        )

    def answer(self) -> Answer | None:
        """The best explanation of the session; None if no hypothesis explains it."""
        discrete = [*self._discrete()]
        return (
            self._best([*discrete, *self._others()], discrete)
            or self._moved()
            or self._best([*self._offsets()], ())
            or self._best([*self._pairs(discrete), *self._mixed(discrete)], ())
        )

    def _best(self, changes: Sequence[Change], alike: Sequence[Change]) -> Answer | None:
        """The first change with nearly the smallest residual, if that is clearly smaller."""
        scored = [(change, *self.left(change)) for change in changes]
        before = self.placed.typical
        good = [
            (change, left)
            for change, left, misfit in scored
            if misfit <= EXPLAINED and left * _CLEARLY <= before
        ]
        if not good:
            return None
        least = min(left for _, left in good)
        near = [change for change, left in good if left <= _ALIKE * least]
        near = self._upright(near)
        best = near[0]
        was = f"{1e3 * before:.3g} mm" if np.isfinite(before) else "no reachable pose"
        evidence = (
            f"nominal robot and tracker then agree within {1e3 * least:.3g} mm (median), as "
            f"recorded within {was}; tolerances explain "
            f"{1e3 * least / self._misfit_of(scored, best):.2g} mm"
        )
        different: dict[tuple[str, str | None], Change] = {}
        for change in near[1:]:
            same = change.mistake == best.mistake
            if change in alike and not (same and change.streams == (TRACKER,)):
                different.setdefault((change.mistake, change.part if same else None), change)
        parts = best.parts if isinstance(best, Pair) else (best,)
        return Answer(parts, evidence, tuple(different.values()))

    def _misfit_of(self, scored: list[tuple[Change, float, float]], best: Change) -> float:
        return next(misfit for change, _, misfit in scored if change is best)

    def _upright(self, near: list[Change]) -> list[Change]:
        """Put the changes first with which the rotations agree, or the tracker is upright.

        Points alone do not show which axis of a left-handed frame has the opposite sign.
        """
        of_frame = [c for c in near if c.mistake in ("frame_mirrored", "axes_swapped")]
        if len(of_frame) < 2:
            return near
        score = {id(c): turn_misfit(c.undo(self.few), self.robot) for c in of_frame}
        known = [c for c in of_frame if score[id(c)] is not None]
        if known:
            least = min(doubt(score[id(c)]) for c in known)
            if least < DOUBTED:
                right = [c for c in known if doubt(score[id(c)]) <= 2 * least + 1e-3]
                return [*right, *(c for c in near if c not in of_frame)]
        upright = [
            c
            for c in of_frame
            if place(c.undo(self.few), self.robot).frame.rotation[2, 2] > _UPRIGHT
        ]
        return [*(upright or of_frame), *(c for c in near if c not in of_frame)]

    def _discrete(self) -> Iterator[Change]:
        """Mistakes without a parameter, the likelier ones first."""
        streams = joint_streams(self.few)
        yield from hypotheses.unit_of_tracker()
        yield from hypotheses.unit_of_joints(self.robot, streams)
        yield from hypotheses.handedness()
        yield from hypotheses.orders_of_joints(self.robot, streams)
        yield from hypotheses.signs_of_joints(self.robot, streams)

    def _others(self) -> Iterator[Change]:
        """Coordinates in two units, rows shifted against each other, other robots and files."""
        yield from hypotheses.unit_of_coordinates()
        yield from self._shifts()
        if self.document is not None:
            yield from robot_file.edited_files(self.document, self.source)
        yield from robot_file.other_robots(self.robot)

    def _shifts(self) -> Iterator[Change]:
        """Readings of a table were shifted by some rows against their joints."""
        tracker = self.session.tracker
        if tracker is None:
            return
        pitch = float(np.median(np.diff(tracker.stamp_ns)))
        if pitch * 1e-9 <= SPARSE:
            return
        for rows in (k for n in range(1, _SHIFTS + 1) for k in (n, -n)):
            late = round(rows * pitch)
            yield Change(
                "clock_offset",
                (TRACKER,),
                of_tracker(lambda s, late=late: _earlier(s, late)),  # type: ignore[misc]
                f"subtract {late * 1e-9:g} s from its header stamps (--fix does this), or shift "
                f"its columns by {-rows} rows",
                value=late * 1e-9,
                unit="s",
            )

    def _moved(self) -> Answer | None:
        """Answer for a moved tracker or a changed reflector; None if neither explains it."""
        found = moves.roughly(self.stops, self.robot)
        return self._best(found, found) if found else None

    def _offsets(self) -> Iterator[Change]:
        """An offset of each joint, a common one of all, and a common one with opposite signs."""
        robot, streams = self.robot, joint_streams(self.few)
        every = tuple(range(len(robot.joints.names)))
        for which in (*((j,) for j in every), *([every] if len(every) > 1 else ())):
            yield self._offset(which, partial(hypotheses.offset_joints, robot, streams, which))
        yield self._offset(every, partial(_opposite, robot, streams))

    def _offset(self, which: tuple[int, ...], change: Callable[[float], Change]) -> Change:
        """The change with the best offset; `change` builds the hypothesis from an offset."""
        from scipy.optimize import minimize_scalar  # slow to load

        robot = self.robot
        values, _ = joints_and_points(self.few)
        several = robot.joints.unit != "rad" or robot.model().pulls
        reach = float(np.abs(values[:, which]).max()) if len(which) > 1 else 0.0
        most = max(2 * float(np.ptp(values[:, which], axis=0).max()), reach) if several else np.pi

        def left(value: float) -> float:
            placed = place(change(value).undo(self.few), robot)
            return placed.typical if placed.found else 1e6

        grid = np.linspace(-most, most, _GRID + 1)
        best = float(grid[int(np.argmin([left(v) for v in grid]))])
        step = 2 * most / _GRID
        found = minimize_scalar(
            left,
            bounds=(best - step, best + step),
            method="bounded",
            options={"xatol": 1e-4 * most},
        )
        return change(float(found.x))

    def _pairs(self, changes: Sequence[Change]) -> Iterator[Change]:
        """Pairs of mistakes that differ in kind or stream."""
        for one, other in combinations(changes, 2):
            if not (one.mistake == other.mistake and one.streams == (TRACKER,)):
                yield Pair.of(one, other)

    def _mixed(self, changes: Sequence[Change]) -> Iterator[Change]:
        """Coordinates in two units with another mistake, if the points' extents suggest it."""
        wide = _extents(self.few)
        for one in hypotheses.unit_of_coordinates():
            told = _extents(one.undo(self.few))
            if wide[-1] > _MIXED * told[-1] and told[-1] < _MIXED * told[-2]:
                yield from (Pair.of(one, other) for other in changes)


def _extents(session: Session) -> Array:
    """Extents of the points along the tracker's axes, (3,) [m], in rising order."""
    tracker = session.tracker
    if tracker is None or not tracker.position.size:
        return np.zeros(3)
    return np.sort(np.ptp(tracker.position, axis=0))


@dataclass(frozen=True)
class Pair(Change):
    """Hypothesis of two mistakes together."""

    parts: tuple[Change, ...] = ()

    @classmethod
    def of(cls, one: Change, other: Change) -> Pair:
        """Build a pair; `other` is undone after `one`."""
        return cls(
            f"{one.mistake} and {other.mistake}",
            one.streams + other.streams,
            lambda session: other.undo(one.undo(session)),
            "",
            parts=(one, other),
        )


def _opposite(robot: Robot, streams: tuple[str, ...], value: float) -> Pair:
    """Hypothesis that all joints have the opposite sign and the same wrong zero."""
    reversed_, shifted = hypotheses.opposite(robot, streams, value)
    return Pair.of(shifted, reversed_)


def _earlier(stream: TrackerStream, late: int) -> TrackerStream:
    return replace(stream, stamp_ns=stream.stamp_ns - late)


def _spread(placed: Placed) -> float:
    """Root mean square distance of the points from their mean [m]."""
    base = placed.base[np.isfinite(placed.base).all(axis=1)]
    return float(np.sqrt(np.sum((base - base.mean(axis=0)) ** 2, axis=1).mean()))


def _tolerated(placed: Placed, robot: Robot, stops: Session) -> float:
    return expected(placed, robot, joints_and_points(stops)[0]) if placed.found else np.inf
