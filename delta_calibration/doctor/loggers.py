"""What a logger did: values held or interpolated, command and state in exchanged places.

A reading has noise of its own, and so has an encoder; a command has none.
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

_REGULAR = 0.7  # share of the runs that are of the usual length
_EXACT = 1e-5  # of the usual bend of what was really read; noise of a reading is far more
_LEAST_STEPS = 30


def held(session: Session) -> tuple[Session, tuple[Mistake, ...]]:
    """Streams whose values a logger held or interpolated, by their own rows."""
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
                f"record {name} at its own rate, or leave out what is {how} (--fix does)",
                value=round(share, 3),
                unit="1",
            )
            found += change.found(
                f"{100 * share:.0f} % of the values are {how}, exactly, while the machine moves: "
                "a measured value has noise of its own"
            )
            break
    return session, tuple(found)


def _kept(name: str, rows: NDArray[np.bool_]) -> Callable[[Session], Session]:
    """Keep some rows of a stream."""
    if name == TRACKER:
        return of_tracker(lambda s: rows_of(s, rows))
    return of_joints((name,), lambda s: rows_of(s, rows))


def _repeats(_stamps: Stamps, position: Array) -> NDArray[np.bool_] | None:
    """Rows that are new, (n,), where values come in runs of one length; else None.

    A machine that stands repeats its values too, but moves in between, row by row.
    """
    new = np.r_[True, (np.diff(position, axis=0) != 0).any(axis=1)]
    return new if _in_runs(new) else None


def _on_lines(stamps: Stamps, position: Array) -> NDArray[np.bool_] | None:
    """Rows that are not exactly on the line of their neighbours, where they come in runs."""
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
    """Whether what is new comes every so many rows, two or more."""
    runs = np.diff(np.flatnonzero(new))
    if len(runs) < _LEAST_STEPS:
        return False
    usual = float(np.median(runs))
    return usual >= 2 and float((np.abs(runs - usual) <= 1).mean()) >= _REGULAR


def _has_noise(position: Array, real: NDArray[np.bool_]) -> bool:
    """Whether what was really measured has noise, so that a straight line is no motion law."""
    steps = np.abs(np.diff(position[real], axis=0)).max(axis=1)
    return bool((steps > 0).mean() > 0.9)


def exchanged(session: Session) -> Change | None:
    """Command and state in each other's place: the command has the noise."""
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
    """Share of the steps in which nothing changes at all."""
    return float((np.diff(stream.position, axis=0) == 0).all(axis=1).mean())
