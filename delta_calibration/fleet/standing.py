"""State of each machine of a fleet on a day, according to its history.

A machine has one state, the first of these that applies:

- unknown: its last session gave no verdict, or one with structure that no cause explains;
- drifted: something changed between its sessions, within the period that counts as lately;
- cause: its last verdict names a cause that a calibration of the dimensions does not remove;
- not measured lately;
- fine.

What else is true of it follows in the reason: a cause beside a change, a last session or a change
that is not recent, and sessions that were never compared, so that no change is known.

After an update (a session fitted with earlier sessions as prior) the verdict before it holds.

The stake is the error [mm RMS] that a visit may remove: the error of the calibrated dimensions
beyond the extended model, the error that no cause explains, or the tool's motion by a change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import sqrt
from typing import Any

from delta_calibration.wording import listed, spoken

UNKNOWN, DRIFTED, CAUSE, STALE, FINE = (
    "unknown",
    "drifted",
    "cause",
    "not measured lately",
    "fine",
)
STATES = (UNKNOWN, DRIFTED, CAUSE, STALE, FINE)
_DIMENSIONS = "geometry"  # kind of a finding that the calibration itself corrects


@dataclass(frozen=True)
class Measured:
    """The data of a session that the state of its machine depends on."""

    id: str
    began: datetime
    verdict: Mapping[str, Any] | None
    error_left_mm: float  # error left of its own fit
    noise_mm: float  # noise of a pose
    poses: int
    is_update: bool = False  # fitted with earlier sessions as prior; the verdict before it holds


@dataclass(frozen=True)
class Known:
    """Sessions, changes and failures of a machine."""

    machine: str
    robot: str
    sessions: tuple[Measured, ...]  # in order of time, at least one
    changes: tuple[Mapping[str, Any], ...] = ()
    failed: tuple[str, ...] = ()  # error messages of sessions without a result
    compared: bool = True  # whether all its sessions were compared to find changes


@dataclass(frozen=True)
class Standing:
    """State of a machine, with reason, action and error at stake."""

    machine: str
    robot: str
    state: str
    why: str
    to_do: str
    last: datetime
    sessions: int
    error_left_mm: float
    stake_mm: float
    findings: tuple[Mapping[str, Any], ...]  # of the last verdict, causes beyond the dimensions
    changes: tuple[Mapping[str, Any], ...]  # lately
    failed: tuple[str, ...]
    compared: bool = True  # whether all its sessions were compared to find changes


def standing(known: Known, day: datetime, lately: timedelta) -> Standing:
    """Determine the state of a machine on a day.

    Args:
        known: sessions, changes and failures of the machine.
        day: date for which the state is determined.
        lately: longest age of a session or change that counts as lately.
    """
    last = known.sessions[-1]
    judged = next((each for each in reversed(known.sessions) if not each.is_update), last)
    changes = _recent(known, day - lately)
    findings = _causes(judged)
    state, why, to_do, stake = _fine()
    age = _age(last, day) if day - last.began > lately else ""
    if age:
        state, why, to_do = STALE, age, "measure"
    if findings:
        state, why, to_do, stake = _caused(judged, findings)
    if changes:
        state, why, to_do, stake = _drifted(known, changes, stake)
    if judged.verdict is None or judged.verdict["unknown_structure"]["found"]:
        state, why, to_do, stake = _unknown(judged, stake)
    also = _also(known, state, findings, changes, age)
    return Standing(
        known.machine,
        known.robot,
        state,
        f"{why}; also: {'; '.join(also)}" if also else why,
        to_do,
        last.began,
        len(known.sessions),
        last.error_left_mm,
        stake,
        findings,
        changes,
        known.failed,
        known.compared,
    )


def first_visits(fleet: Sequence[Standing]) -> tuple[Standing, ...]:
    """Machines that need a visit: largest stake first, then the longest not measured."""
    asking = [each for each in fleet if each.state != FINE]
    return tuple(sorted(asking, key=lambda each: (-each.stake_mm, each.last, each.machine)))


def called(finding: Mapping[str, Any]) -> str:
    """Cause and location of a finding or a change, in words."""
    where = f" at {spoken(finding['location'])}" if finding["location"] else ""
    return f"{spoken(finding.get('cause') or finding['what'])}{where}"


def _age(last: Measured, day: datetime) -> str:
    return f"last measured {(day - last.began).days} days ago"


def _changed(changes: Sequence[Mapping[str, Any]]) -> str:
    """The changes in words, each with the two sessions around it."""
    told = (f"{called(c)} changed between {c['after']} and {c['before']}" for c in changes)
    return "; ".join(told)


def _also(
    known: Known,
    state: str,
    findings: Sequence[Mapping[str, Any]],
    changes: Sequence[Mapping[str, Any]],
    age: str,
) -> tuple[str, ...]:
    """What else is true of a machine; `age` is empty if its last session is recent."""
    earlier = [each for each in known.changes if each not in changes]
    told = (
        _changed(changes) if state == UNKNOWN else "",
        listed(called(each) for each in findings) if state in (UNKNOWN, DRIFTED) else "",
        age if state != STALE else "",
        f"not lately: {_changed(earlier)}" if earlier else "",
        "" if known.compared else "its sessions were not compared, so no change is known",
    )
    return tuple(text for text in told if text)


def _fine() -> tuple[str, str, str, float]:
    return FINE, "nothing beyond the dimensions, which are in its calibration", "nothing", 0.0


def _caused(last: Measured, findings: Sequence[Mapping[str, Any]]) -> tuple[str, str, str, float]:
    actions = [each["action"] for each in findings if "action" in each]
    orders = (f"{each['do']} ({spoken(each['part'])})" for each in actions)
    return (
        CAUSE,
        listed(called(each) for each in findings),
        "; ".join(dict.fromkeys(orders)) or "see its verdict",
        _beyond(last),
    )


def _drifted(
    known: Known, changes: Sequence[Mapping[str, Any]], stake: float
) -> tuple[str, str, str, float]:
    moved = max(_moves_mm(known, change) for change in changes)
    return (
        DRIFTED,
        _changed(changes),
        "calibrate anew, and look at the part that changed",
        max(moved, stake),
    )


def _unknown(last: Measured, stake: float) -> tuple[str, str, str, float]:
    if last.verdict is None:
        return UNKNOWN, "fitted only: no causes were looked for", "diagnose", stake
    structure = last.verdict["unknown_structure"]
    moves = spoken(structure["moves_with"] or "nothing that was recorded")
    left = max(stake, structure["rms_mm"] or 0.0)
    return UNKNOWN, f"structure that no cause explains; it varies with {moves}", "measure", left


def _causes(last: Measured) -> tuple[Mapping[str, Any], ...]:
    findings = last.verdict["findings"] if last.verdict is not None else ()
    return tuple(each for each in findings if each["kind"] != _DIMENSIONS)


def _beyond(last: Measured) -> float:
    """Held-out error of the calibrated model beyond the extended one [mm RMS], in squares."""
    if last.verdict is None:
        return 0.0
    calibrated = last.verdict["calibrated"]["held_out_rms_mm"] or 0.0
    extended = last.verdict["extended"]["held_out_rms_mm"] or 0.0
    return sqrt(max(calibrated**2 - extended**2, 0.0))


def _recent(known: Known, since: datetime) -> tuple[Mapping[str, Any], ...]:
    """Changes whose first session after the change began at `since` or later."""
    began = {each.id: each.began for each in known.sessions}
    return tuple(c for c in known.changes if began.get(c["before"], since) >= since)


def _moves_mm(known: Known, change: Mapping[str, Any]) -> float:
    """Motion of the tool by a change [mm RMS], without what a new fit of the rest absorbs.

    The signal lambda of a change is the sum of squares of this motion divided by the noise, over
    three coordinates per pose of all sessions after the change.
    """
    ids = [each.id for each in known.sessions]
    behind = known.sessions[ids.index(change["before"]) :] if change["before"] in ids else ()
    poses = sum(each.poses for each in behind)
    if not poses:
        return 0.0
    return behind[-1].noise_mm * sqrt(max(change.get("signal", 0.0), 0.0) / (3 * poses))
