"""Mistakes in a recorded session, and the changes that undo them.

A hypothesis about a mistake is a `Change`: it converts the session to what it would be without the
mistake. It applies to the streams of a session and to its stops alike, as both are sessions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import JointStream, Session, TrackerStream
from delta_calibration.documents import Document
from delta_calibration.robot import Robot
from delta_calibration.wording import spoken

Array = NDArray[np.float64]

COMMAND, STATES, TRACKER, ROBOT_FILE = "joint_command", "joint_states", "tracker", "robot_file"
JOINTS = (COMMAND, STATES)
ALTERNATIVE = "this session cannot distinguish it from"  # begins the evidence of an alternative


@dataclass(frozen=True)
class Mistake:
    """A mistake that was found; `value` is in `unit`, and None if the mistake has no size."""

    mistake: str
    stream: str
    part: str | None
    value: float | None
    unit: str | None
    evidence: str
    mend: str

    @property
    def is_alternative(self) -> bool:
        """Whether it is an alternative to another mistake that explains the session as well."""
        return self.evidence.startswith(ALTERNATIVE)

    @property
    def called(self) -> str:
        """The mistake and its stream in words, such as `clock offset in tracker`."""
        return called(self.mistake, self.stream)

    def sentence(self) -> str:
        """The mistake as one sentence for messages."""
        where = f" ({self.part})" if self.part else ""
        return f"{self.called}{where}: {self.evidence}; {self.mend}"


@dataclass(frozen=True)
class Change:
    """Hypothesis of a mistake in one or more streams, with the function that undoes it.

    Attributes:
        mistake: its fixed name.
        streams: names of the affected streams.
        undo: returns the session without the mistake.
        mend: manual remedy, as a phrase.
        part: affected part of the robot or the stream.
        value: its size in `unit`.
        robot: robot to use instead, if the robot file is wrong.
        document: corrected robot file, if lines of it are wrong.
    """

    mistake: str
    streams: tuple[str, ...]
    undo: Callable[[Session], Session]
    mend: str
    part: str | None = None
    value: float | None = None
    unit: str | None = None
    robot: Robot | None = None
    document: Document | None = field(default=None, repr=False)

    def found(self, evidence: str) -> tuple[Mistake, ...]:
        """The mistake with its evidence, once for each affected stream."""
        return tuple(
            Mistake(self.mistake, stream, self.part, self.value, self.unit, evidence, self.mend)
            for stream in self.streams
        )


@dataclass(frozen=True)
class Answer:
    """Mistakes that together explain a session, and alternatives that explain it equally well."""

    changes: tuple[Change, ...]
    evidence: str
    others: tuple[Change, ...] = ()

    def by(self, mistake: str) -> Answer:
        """The same answer, but with the named alternative preferred, if there is one."""
        named = [other for other in self.others if other.mistake == mistake]
        if len(self.changes) > 1 or not named:
            return self
        rest = tuple(other for other in self.others if other is not named[0])
        return Answer((named[0],), self.evidence, (*self.changes, *rest))


def called(mistake: str, stream: str) -> str:
    """A mistake and its stream in words."""
    return f"{spoken(mistake)} in {spoken(stream)}"


def as_it_is(session: Session) -> Session:
    """Leave a session unchanged."""
    return session


def of_joints(
    streams: tuple[str, ...], change: Callable[[JointStream], JointStream]
) -> Callable[[Session], Session]:
    """Change joint streams of a session; missing streams stay missing."""

    def undo(session: Session) -> Session:
        command, states = session.command, session.states
        if command is not None and COMMAND in streams:
            command = change(command)
        if states is not None and STATES in streams:
            states = change(states)
        return replace(session, command=command, states=states)

    return undo


def of_angles(
    streams: tuple[str, ...], change: Callable[[Array], Array]
) -> Callable[[Session], Session]:
    """Change the joint values (n, m) of streams whose columns are in the robot's order."""
    return of_joints(streams, lambda s: replace(s, position=change(s.position)))


def of_tracker(change: Callable[[TrackerStream], TrackerStream]) -> Callable[[Session], Session]:
    """Change the tracker's stream of a session."""

    def undo(session: Session) -> Session:
        tracker = session.tracker
        return replace(session, tracker=None if tracker is None else change(tracker))

    return undo


def of_points(change: Callable[[Array], Array]) -> Callable[[Session], Session]:
    """Change the tracker's points (n, 3)."""
    return of_tracker(lambda s: replace(s, position=change(s.position)))


def rows_of(stream: Any, keep: NDArray[Any]) -> Any:
    """The stream with some of its rows only."""
    each = {k: v[keep] for k, v in vars(stream).items() if isinstance(v, np.ndarray)}
    return replace(stream, **each)


def joints_of(session: Session, stream: str) -> JointStream | None:
    """A joint stream by its name."""
    return session.command if stream == COMMAND else session.states


def joint_streams(session: Session) -> tuple[str, ...]:
    """Names of the joint streams that a session has."""
    return tuple(name for name in JOINTS if joints_of(session, name) is not None)


def in_order(session: Session, names: tuple[str, ...]) -> Session:
    """The session with joints in the robot's order and strictly rising stamps."""

    def ordered(stream: JointStream) -> JointStream:
        columns = [stream.names.index(name) for name in names]
        _, rows = np.unique(stream.stamp_ns, return_index=True)
        return JointStream(stream.stamp_ns[rows], names, stream.position[rows][:, columns])

    def risen(stream: TrackerStream) -> TrackerStream:
        risen_rows: TrackerStream = rows_of(
            stream, np.unique(stream.stamp_ns, return_index=True)[1]
        )
        return risen_rows

    return of_tracker(risen)(of_joints(JOINTS, ordered)(session))
