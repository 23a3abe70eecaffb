"""Hypotheses tried on the drawing in its best frame: which of them explains a session's stops.

Single mistakes first, then pairs of those without a parameter. One is taken where it leaves a
quarter of what was left or less, and no more than parts within their tolerances explain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
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
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

EXPLAINED = 2.0  # times what tolerances do: what is left of a session without a mistake
UNEXPLAINED = 4.0  # times the same from which something is wrong
# of the spread of the points, beyond which tolerances of a machine never go (near a singularity
# they would): of a hypothesis, and of a session as it is
_SHARE = 0.01, 0.05
_CLEARLY = 4.0  # times less is left than before
_ALIKE = 1.5  # times the least that is left: not to be told from it
_TRIED = 80  # stops
_GRID = 48
_SHIFTS = 8  # rows of a table by which joints and readings may be apart
_UPRIGHT = 0.9
_MIXED = 5.0  # times: what coordinates in two units make extents differ by; a workspace is rounder


@dataclass(frozen=True)
class Trial:
    """A session before the drawing of a robot.

    `session` is whole, its joints in the robot's order, `stops` are its stops.
    """

    session: Session
    robot: Robot
    stops: Session
    document: Document | None = None
    source: str = ""

    @cached_property
    def few(self) -> Session:
        """Some of the stops, evenly over the session."""
        return thinned(self.stops, _TRIED)

    @cached_property
    def placed(self) -> Placed:
        """The drawing in its best frame."""
        return place(self.few, self.robot)

    @cached_property
    def tolerated(self) -> float:
        """What tolerances explain [m]."""
        own = _tolerated(self.placed, self.robot, self.few)
        return min(own, _SHARE[1] * _spread(self.placed))

    @property
    def misfit(self) -> float:
        """What is left, in times what tolerances explain."""
        return self.placed.typical / self.tolerated if self.placed.found else np.inf

    def left(self, change: Change) -> tuple[float, float]:
        """Typical distance with a mistake undone [m], and the same over what tolerances do."""
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
        """What explains the session; None where nothing does."""
        discrete = [*self._discrete()]
        return (
            self._best([*discrete, *self._others()], discrete)
            or self._moved()
            or self._best([*self._offsets()], ())
            or self._best([*self._pairs(discrete), *self._mixed(discrete)], ())
        )

    def _best(self, changes: Sequence[Change], alike: Sequence[Change]) -> Answer | None:
        """The first of the changes that leaves nearly the least, if that is clear."""
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
        """Those first that let turns of the probe agree, or the tracker stand upright.

        Which axis of a left-handed frame has the other sign is nothing that points tell.
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
        """Mistakes without a parameter, likelier ones first."""
        streams = joint_streams(self.few)
        yield from hypotheses.unit_of_tracker()
        yield from hypotheses.unit_of_joints(self.robot, streams)
        yield from hypotheses.handedness()
        yield from hypotheses.orders_of_joints(self.robot, streams)
        yield from hypotheses.signs_of_joints(self.robot, streams)

    def _others(self) -> Iterator[Change]:
        """Coordinates in two units, readings a row beside their joints; other robots and files."""
        yield from hypotheses.unit_of_coordinates()
        yield from self._shifts()
        if self.document is not None:
            yield from robot_file.edited_files(self.document, self.source)
        yield from robot_file.other_robots(self.robot)

    def _shifts(self) -> Iterator[Change]:
        """Readings of a table some rows beside their joints."""
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
        """A tracker that was moved, a reflector that was changed."""
        found = moves.roughly(self.stops, self.robot)
        return self._best(found, found) if found else None

    def _offsets(self) -> Iterator[Change]:
        """An offset of each joint, one of all of them, and that with all of the other sign."""
        robot, streams = self.robot, joint_streams(self.few)
        every = tuple(range(len(robot.joints.names)))
        for which in (*((j,) for j in every), *([every] if len(every) > 1 else ())):
            yield self._offset(which, partial(hypotheses.offset_joints, robot, streams, which))
        yield self._offset(every, partial(_opposite, robot, streams))

    def _offset(self, which: tuple[int, ...], change: Callable[[float], Change]) -> Change:
        """The best offset of some joints, of the changes that each offset is."""
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
        """Two mistakes, of different kinds or places."""
        for one, other in combinations(changes, 2):
            if not (one.mistake == other.mistake and one.streams == (TRACKER,)):
                yield Pair.of(one, other)

    def _mixed(self, changes: Sequence[Change]) -> Iterator[Change]:
        """Coordinates in two units and another mistake, where the points' extents look like it."""
        wide = _extents(self.few)
        for one in hypotheses.unit_of_coordinates():
            told = _extents(one.undo(self.few))
            if wide[-1] > _MIXED * told[-1] and told[-1] < _MIXED * told[-2]:
                yield from (Pair.of(one, other) for other in changes)


def _extents(session: Session) -> Array:
    """Of the points along the tracker's axes, (3,) [m], from the smallest to the largest."""
    tracker = session.tracker
    if tracker is None or not tracker.position.size:
        return np.zeros(3)
    return np.sort(np.ptp(tracker.position, axis=0))


@dataclass(frozen=True)
class Pair(Change):
    """Two mistakes undone together."""

    parts: tuple[Change, ...] = ()

    @classmethod
    def of(cls, one: Change, other: Change) -> Pair:
        """The second undone after the first."""
        return cls(
            f"{one.mistake} and {other.mistake}",
            one.streams + other.streams,
            lambda session: other.undo(one.undo(session)),
            "",
            parts=(one, other),
        )


def _opposite(robot: Robot, streams: tuple[str, ...], value: float) -> Pair:
    """All joints of the other sign, from one other zero."""
    reversed_, shifted = hypotheses.opposite(robot, streams, value)
    return Pair.of(shifted, reversed_)


def _earlier(stream: TrackerStream, late: int) -> TrackerStream:
    return replace(stream, stamp_ns=stream.stamp_ns - late)


def _spread(placed: Placed) -> float:
    """Root mean square distance of the points from their middle [m]."""
    base = placed.base[np.isfinite(placed.base).all(axis=1)]
    return float(np.sqrt(np.sum((base - base.mean(axis=0)) ** 2, axis=1).mean()))


def _tolerated(placed: Placed, robot: Robot, stops: Session) -> float:
    return expected(placed, robot, joints_and_points(stops)[0]) if placed.found else np.inf
