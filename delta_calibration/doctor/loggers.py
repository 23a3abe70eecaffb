"""Finds mistakes of a logger: values held or interpolated, command and state exchanged.

Each tracker reading and each encoder value has its own noise; a command has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import JointStream, Session
from delta_calibration.doctor.change import (
    COMMAND,
    STATES,
    TRACKER,
    Change,
    Mistake,
    of_joints,
    of_tracker,
    rows_of,
)

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

_REGULAR = 0.7  # least share of the runs that have the usual length
_EXACT = 1e-5  # of the usual curvature of measured values; measurement noise is far larger
_LEAST_STEPS = 30


def held(session: Session) -> tuple[Session, tuple[Mistake, ...]]:
    """Find streams whose values a logger held or interpolated, and remove those rows."""
    found: list[Mistake] = []
    for name in (STATES, TRACKER):
        stream = session.tracker if name == TRACKER else session.states
        if stream is None or len(stream.stamp_ns) < _LEAST_STEPS:
            continue
        noisy = session.states is None or session.command is None or name == TRACKER
        for how, keep in (("held", _repeats), ("interpolated", _on_lines)):
            real = keep(stream.stamp_ns, stream.position)
            if real is None or not (noisy or _has_noise(stream.position, real)):
                continue
            share = 1.0 - float(real.mean())
            undo = _kept(name, real)
            session = undo(session)
            change = Change(
                "held_values",
                (name,),
                undo,
                f"record {name} at its own rate, or leave out the {how} values (--fix does this)",
                value=round(share, 3),
                unit="1",
            )
            found += change.found(
                f"{100 * share:.0f} % of the values are {how} exactly while the machine moves; "
                "measured values always have noise"
            )
            break
    return session, tuple(found)


def _kept(name: str, rows: NDArray[np.bool_]) -> Callable[[Session], Session]:
    """Function that keeps only some rows of a stream."""
    if name == TRACKER:
        return of_tracker(lambda s: rows_of(s, rows))
    return of_joints((name,), lambda s: rows_of(s, rows))


def _repeats(_stamps: Stamps, position: Array) -> NDArray[np.bool_] | None:
    """Mask of the rows with new values, (n,), if values repeat in runs of one length; else None.

    A machine at rest repeats its values too, but between stops its values change in every row.
    """
    new = np.r_[True, (np.diff(position, axis=0) != 0).any(axis=1)]
    return new if _in_runs(new) else None


def _on_lines(stamps: Stamps, position: Array) -> NDArray[np.bool_] | None:
    """Mask of the rows not exactly on the line of their neighbours, if in runs; else None."""
    time = (stamps - stamps[0]) * 1e-9
    if len(np.unique(stamps)) < len(stamps):
        return None
    share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    bend = np.abs(position[1:-1] - position[:-2] - share * (position[2:] - position[:-2]))
    bend = bend.max(axis=1)
    straight = bend <= _EXACT * np.quantile(bend, 0.97)
    real = np.r_[True, ~straight, True]
    return real if _in_runs(real) else None


def _in_runs(new: NDArray[np.bool_]) -> bool:
    """Whether new values come at a regular interval of two or more rows."""
    runs = np.diff(np.flatnonzero(new))
    if len(runs) < _LEAST_STEPS:
        return False
    usual = float(np.median(runs))
    return usual >= 2 and float((np.abs(runs - usual) <= 1).mean()) >= _REGULAR


def _has_noise(position: Array, real: NDArray[np.bool_]) -> bool:
    """Whether measured values have noise, so that a straight line is not just the motion."""
    steps = np.abs(np.diff(position[real], axis=0)).max(axis=1)
    return bool((steps > 0).mean() > 0.9)


def exchanged(session: Session) -> Change | None:
    """Hypothesis that command and state were exchanged, if it is the command that has noise."""
    command, states = session.command, session.states
    if command is None or states is None or len(states.stamp_ns) < _LEAST_STEPS:
        return None
    if len(command.stamp_ns) < _LEAST_STEPS or set(command.names) != set(states.names):
        return None
    quiet = _still_share(states), _still_share(command)
    if not (quiet[0] > 0.1 and quiet[1] < 0.1 * quiet[0]):
        return None
    return Change(
        "streams_exchanged",
        (COMMAND, STATES),
        lambda s: replace(
            s,
            command=s.states,
            states=s.command,
        ),
        "--topic command=/joint_states --topic states=/joint_command",
    )


def _still_share(stream: JointStream) -> float:
    """Share of the time steps in which no joint changes."""
    return float((np.diff(stream.position, axis=0) == 0).all(axis=1).mean())
