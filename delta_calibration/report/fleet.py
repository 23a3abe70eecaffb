"""Report of a fleet: machines by state, shared causes, and the order of visits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime

import numpy as np

from delta_calibration.fleet.shared import Shared
from delta_calibration.fleet.standing import (
    CAUSE,
    DRIFTED,
    FINE,
    STALE,
    STATES,
    UNKNOWN,
    Standing,
    first_visits,
)
from delta_calibration.report.document import KeyFigure, Report, Section, Statement, Table
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    EXTENDED,
    GREY,
    SYMBOLS,
    THIRD,
    Axis,
    Figure,
    Panel,
    Points,
)
from delta_calibration.wording import NO_VALUE, capital, chance, figures, listed, mm, spoken

_FIRST = 10  # visits listed first; the others are in the table of all machines
_WIDE = 20.0  # ratio of largest to smallest error above which the axis is logarithmic
_FREQUENT = 8  # causes listed with their numbers of machines
_NAMED = 6  # machines named in a sentence
_COLOUR = {UNKNOWN: THIRD, DRIFTED: BEFORE, CAUSE: CALIBRATED, STALE: GREY, FINE: EXTENDED}


def page_of_fleet(
    fleet: Sequence[Standing],
    shared: Sequence[Shared],
    never: Mapping[str, Sequence[str]],
    day: datetime,
    lately_days: int,
) -> Report:
    """Make the report of a fleet.

    Args:
        fleet: state of each machine, at least one.
        shared: causes shared by machines, most certain first.
        never: machines without a result of any session, with the messages about them.
        day: date of the report.
        lately_days: age up to which a session or a change counts as recent [days].
    """
    of, visits = Counter(each.state for each in fleet), first_visits(fleet)
    return Report(
        title=f"Fleet of {_count(len(fleet))}",
        subtitle=f"{sum(each.sessions for each in fleet)} sessions; as of {day:%Y-%m-%d}",
        sentence=_sentence(of, len(fleet)),
        statements=(
            Statement("What to visit first", _first(visits)),
            Statement("What machines share", _sharing(shared)),
            Statement("What could not be used", _unused(fleet, never)),
        ),
        key_figures=tuple(
            KeyFigure(state, str(of[state]), "of " + str(len(fleet)), _MEANING[state])
            for state in STATES
            if state != FINE
        ),
        sections=(
            Section(
                "visits", "What to visit first", (_AT_STAKE,), tables=(_visits(visits[:_FIRST]),)
            ),
            Section(
                "shared",
                "What machines share",
                (_HOW_SHARED,),
                tables=(_shared(shared), *_frequent(fleet)),
            ),
            Section("states", "Machines by state", figures=(_errors(fleet, day),)),
            Section(
                "machines",
                "All machines",
                (f"Lately means within {lately_days} days.", _EXCLUSIVE),
                tables=(_all(fleet), *_failed(fleet, never)),
            ),
        ),
        data={
            "machines": {
                each.machine: {
                    "state": each.state,
                    "why": each.why,
                    "at_stake_mm": each.stake_mm,
                    "error_left_rms_mm": each.error_left_mm,
                    "last": each.last.isoformat(),
                }
                for each in fleet
            },
            "shared": [
                {"what": each.what, "machines": list(each.machines), "p_value": each.p_value}
                for each in shared
            ],
        },
    )


_MEANING = {
    UNKNOWN: "no verdict, or structure without a cause",
    DRIFTED: "something changed between sessions lately, and not unknown",
    CAUSE: "a cause beyond the dimensions, and neither of these",
    STALE: "last session too long ago, and none of these",
}
_COUNTED = {
    UNKNOWN: "of unknown state",
    DRIFTED: "drifted",
    CAUSE: "with a cause",
    STALE: "not measured lately",
}
_EXCLUSIVE = (
    f"A machine counts once, in the first state that applies: {', '.join(STATES)}. What else is "
    'true of it follows after "also:" in its reason.'
)
_AT_STAKE = (
    "At stake: the error that a visit can remove. It is the error of the calibrated model in "
    "excess of the extended model, or the displacement of the tool by a change. Machines with "
    "most at stake come first, then those that were not measured for longest."
)
_HOW_SHARED = (
    "A cause is shared if more machines have it than chance explains, given how often all other "
    "causes are found in this fleet; p is the probability of as many by chance anywhere in the "
    "fleet. Perhaps: p is 0.001 or more, and below 0.05."
)


def _sentence(of: Counter[str], machines: int) -> str:
    fine = of[FINE]
    others = [f"{of[state]} {told}" for state, told in _COUNTED.items() if of[state]]
    rest = f"; {listed(others)}" if others else ""
    return f"{fine} of {_count(machines)} {'is' if 1 in (fine, machines) else 'are'} fine{rest}."


def _count(machines: int) -> str:
    return f"{machines} machine{'' if machines == 1 else 's'}"


def _first(visits: Sequence[Standing]) -> str:
    if not visits:
        return "None: all machines are fine."
    told = [f"{v.machine} ({v.why})" for v in visits[:3]]
    more = len(visits) - len(told)
    return f"{'; '.join(told)}{f'; and {more} more' if more else ''}."


def _sharing(shared: Sequence[Shared]) -> str:
    sure = [_shares(each) for each in shared if each.sure]
    perhaps = [_shares(each) for each in shared if not each.sure]
    told = [f"{'; '.join(sure)}. Check what these machines have in common."] if sure else []
    told += [f"perhaps {'; '.join(perhaps)}."] if perhaps else []
    return " ".join(map(capital, told)) or "Nothing beyond what chance explains."


def _shares(each: Shared) -> str:
    return (
        f"{each.what} in {len(each.machines)} of {each.of} machines, expected by chance "
        f"{figures(each.expected, 2)} (p {_p(each.p_value)})"
    )


def _unused(fleet: Sequence[Standing], never: Mapping[str, Sequence[str]]) -> str:
    count = sum(len(each.failed) for each in fleet) + sum(map(len, never.values()))
    if not count:
        return "Nothing: every session gave a result."
    rest = f"; no result at all of {_names(sorted(never))}" if never else ""
    return f"{count} sessions{rest}: see the table at the end."


def _visits(visits: Sequence[Standing]) -> Table:
    rows = tuple(
        (v.machine, mm(v.stake_mm) if v.stake_mm else NO_VALUE, v.why, v.to_do, v.state)
        for v in visits
    )
    head = ("machine", "at stake [mm]", "why", "what to do", "state")
    return Table("visits", "", head, rows, "", words=(0, 2, 3, 4))


def _shared(shared: Sequence[Shared]) -> Table:
    rows = tuple(
        (
            each.what if each.sure else f"perhaps {each.what}",
            str(len(each.machines)),
            ", ".join(each.machines),
            figures(each.expected, 2),
            chance(each.p_value),
        )
        for each in shared
    )
    head = ("what", "machines", "which", "by chance", "p")
    caption = "" if rows else "Chance explains everything that machines share."
    return Table("shared", "", head, rows, caption, words=(0, 2))


def _frequent(fleet: Sequence[Standing]) -> tuple[Table, ...]:
    """Table of the number of machines with each cause, the most frequent first."""
    causes = (spoken(c) for each in fleet for c in {f["cause"] for f in each.findings})
    counted = sorted(Counter(causes).items(), key=lambda one: (-one[1], one[0]))[:_FREQUENT]
    if not counted:
        return ()
    rows = tuple((cause, str(count)) for cause, count in counted)
    caption = f"{len(fleet)} machines, last verdict of each."
    title = "Most frequent causes"
    return (Table("frequent", title, ("cause", "machines"), rows, caption, words=(0,)),)


def _errors(fleet: Sequence[Standing], day: datetime) -> Figure:
    """Figure of the error left of each machine's last session over its age, by state."""
    every, marks = [each.error_left_mm for each in fleet], []
    ages = [(day - each.last).total_seconds() / 86400 for each in fleet]
    for state, symbol in zip(STATES, SYMBOLS, strict=True):
        here = [each for each in fleet if each.state == state]
        if here:
            age = np.array([(day - each.last).total_seconds() / 86400 for each in here])
            error = np.array([each.error_left_mm for each in here])
            told = tuple(f"{each.machine}: {each.why}" for each in here)
            marks.append(Points(state, age, error, _COLOUR[state], symbol, 6.0, told=told))
    panel = Panel(
        "",
        Axis("days since the last session", low=0.0, high=max(1.0, 1.1 * max(ages))),
        _error_axis(every),
        tuple(marks),
        tall=1.2,
    )
    caption = "One point per machine: the error that the model of its last session leaves."
    return Figure("errors", "Machines by state", caption, (panel,), columns=1)


def _error_axis(every: Sequence[float]) -> Axis:
    """Axis of errors left [mm]: from zero, or logarithmic if they differ much."""
    if max(every) > _WIDE * min(every):
        return Axis("error left [mm]", log=True)
    return Axis("error left [mm]", low=0.0, high=1.2 * max(every))


def _all(fleet: Sequence[Standing]) -> Table:
    rows = tuple(
        (
            each.machine,
            each.state,
            f"{each.last:%Y-%m-%d}",
            str(each.sessions),
            mm(each.error_left_mm),
            mm(each.stake_mm) if each.stake_mm else NO_VALUE,
            each.why,
        )
        for each in sorted(fleet, key=lambda each: (STATES.index(each.state), each.machine))
    )
    head = (
        "machine",
        "state",
        "last",
        "sessions",
        "error left [mm]",
        "at stake [mm]",
        "why",
    )
    return Table("machines", "", head, rows, "", words=(0, 1, 6))


def _failed(fleet: Sequence[Standing], never: Mapping[str, Sequence[str]]) -> tuple[Table, ...]:
    told = {**{each.machine: each.failed for each in fleet}, **never}
    rows = tuple((machine, said) for machine in sorted(told) for said in told[machine])
    if not rows:
        return ()
    title = "Sessions that gave no result"
    return (Table("failed", title, ("machine", "session, and why"), rows, "", words=(0, 1)),)


def _names(machines: Sequence[str]) -> str:
    more = len(machines) - _NAMED
    return f"{', '.join(machines[:_NAMED])} and {more} more" if more > 0 else listed(machines)


def _p(value: float) -> str:
    told = chance(value)
    return told if told.startswith("<") else f"= {told}"
