"""Report of a machine's history: its changes with their times, and each session."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from delta_calibration.history import Change, History
from delta_calibration.report.document import Report, Section, Statement, Table
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    EXTENDED,
    Axis,
    Figure,
    Line,
    Panel,
    Points,
    course,
)
from delta_calibration.wording import mm, reader_unit, spoken, sure

Array = NDArray[np.float64]

_ROOM = 1.25  # factor of the axis beyond the smallest and the largest value
_FEW = 3  # changes that are described in sentences
_BESIDE = 0.3  # overhang of a line beyond the first and last session [sessions]
_TOO_SMALL = 1.0  # smallest chi square on the logarithmic axis


def page_of_history(
    machine: str, found: History, errors: Sequence[tuple[str, datetime, float]]
) -> Report:
    """Make the report of one machine.

    Args:
        machine: name of the machine.
        found: its sessions and the changes between them.
        errors: id, start and error left [mm] of each session by its own fit, in order of time.
    """
    count, began = len(found.changes), [when for _, when, _ in errors]
    return Report(
        title=f"Change log of {machine}",
        subtitle=f"{len(errors)} sessions, {began[0]:%Y-%m-%d} to {began[-1]:%Y-%m-%d}",
        sentence=f"{count or 'No'} change{'' if count == 1 else 's'} of the machine found.",
        statements=(
            Statement("What changed", " ".join(f"{_upper(s)}." for s in _told(found))),
            Statement(
                "Method",
                "All sessions are fitted together. The tracker's place and the reflector's "
                "mounting belong to each session; they are never reported as a change of the "
                "machine.",
            ),
        ),
        key_figures=(),
        sections=(
            Section(
                "changes", "What changed, and when", tables=(_log(found),), figures=_courses(found)
            ),
            Section("sessions", "Sessions", tables=(_sessions(errors),), figures=(_fit(found),)),
        ),
        data={"machine": machine, "changes": [change.as_dict() for change in found.changes]},
    )


def _told(found: History) -> tuple[str, ...]:
    """Sentences of the change log, limited to the first few changes: all are in the table."""
    count, every = len(found.changes), found.sentences()
    if count <= _FEW:
        return every
    more = f"{count - _FEW} more changes are in the table below"
    return (*every[:_FEW], more, *every[count:])


def _upper(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _log(found: History) -> Table:
    return Table(
        "changes",
        "Change log",
        ("between", "what", "where", "from", "to", "change", "sure", "or"),
        tuple(_row(change) for change in found.changes),
        "With standard errors. Sure: probability that cause, place and time are right. Or: "
        "alternatives.",
        words=(0, 1, 2, 7),
    )


def _row(change: Change) -> tuple[str, ...]:
    return (
        change.gap(),
        spoken(change.what),
        spoken(change.location or ""),
        *change.told(),
        sure(change.confidence),
        ", ".join(change.rivals),
    )


def _courses(found: History) -> tuple[Figure, ...]:
    """Figure of the parameters that changed, as estimated by each session."""
    if not found.changes:
        return ()
    caption = (
        "Estimate of a changed parameter from each session, with its standard error; all other "
        "parameters have their estimates from all sessions. The line shows the value before and "
        "after the change."
    )
    numbers: dict[tuple[str, str | None, str], list[Change]] = {}
    for change in found.changes:
        numbers.setdefault((change.what, change.location, change.parameter), []).append(change)
    panels = tuple(_course(found.sessions, changes) for changes in numbers.values())
    return (Figure("courses", "Session by session", caption, panels, columns=1),)


def _course(sessions: tuple[str, ...], changes: Sequence[Change]) -> Panel:
    """Panel of one parameter over the sessions, with its changes in order of time."""
    one, place = changes[0], np.arange(len(sessions), dtype=float)
    factor, unit = reader_unit(one.unit, max(abs(v) for c in changes for v in (c.from_, c.to)))
    value, std = factor * np.array(one.course).T
    gaps = [sessions.index(change.after) + 0.5 for change in changes]
    ends = [place[0] - _BESIDE, *np.repeat(gaps, 2), place[-1] + _BESIDE]
    levels = [one.from_, *(v for c in changes for v in (c.from_, c.to)), changes[-1].to]
    where = f" of {spoken(one.location)}" if one.location else ""
    return Panel(
        f"{spoken(one.what)}{where}",
        Axis.side_by_side("session", sessions),
        Axis(f"{spoken(one.parameter)} [{unit}]"),
        (
            Points("by this session", place, value, CALIBRATED, "circle", 7.0, error=std),
            Line("by all sessions", np.array(ends), factor * np.array(levels), EXTENDED),
        ),
    )


def _sessions(errors: Sequence[tuple[str, datetime, float]]) -> Table:
    rows = tuple((name, f"{when:%Y-%m-%d %H:%M}", mm(error)) for name, when, error in errors)
    head = ("session", "began", "error left [mm]")
    return Table("sessions", "Each by its own fit", head, rows, words=(0, 1))


def _fit(found: History) -> Figure:
    every = np.concatenate([_shown(found.before), _shown(found.after)])
    place = np.arange(len(found.sessions), dtype=float)
    panel = Panel(
        "",
        Axis.side_by_side("session", found.sessions),
        Axis(
            "chi square above the session's own fit",
            log=True,
            low=float(every.min()) / _ROOM,
            high=float(every.max()) * _ROOM,
        ),
        (
            *course(
                "one machine, unchanged", place, _shown(found.before), BEFORE, "dash", "diamond"
            ),
            *course("with the changes", place, _shown(found.after), EXTENDED, "solid", "circle"),
        ),
        tall=1.2,
    )
    return Figure(
        "misfit",
        "How well one machine explains each session",
        "If nothing is left unexplained, both are close to the number of values that the data "
        "determine.",
        (panel,),
        columns=1,
    )


def _shown(value: Array) -> Array:
    return np.asarray(np.maximum(value, _TOO_SMALL))
