"""Detect rows of a table that are copies of others, not independent measurements.

A reading has noise in its last digits. Two rows with the same commands and the same measured
values to the last digit are copies of one measurement, unless the digits are too coarse to show
noise. The probability of that follows from the step of the last digit and the tracker's noise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, erf

from delta_calibration.errors import InputError
from delta_calibration.recording.table_mapping import Column, TableMapping
from delta_calibration.tables import Row
from delta_calibration.texts import number_of

Mask = NDArray[np.bool_]

_CHANCE = 1e-4  # probability of so many equal rows by rounding; below it they are copies
_SHOWN = 6  # ranges of lines in a message, at most
_WAYS = "`repeated: skip` in the mapping leaves {} out, `keep` uses {}"


def new_rows(
    rows: Sequence[Row], moves: Mask, mapping: TableMapping, sigma: float
) -> tuple[Mask, list[str]]:
    """Mask (n,) of the rows that are independent measurements, and notes on the others.

    Args:
        rows: of the table.
        moves: (n,) rows in motion, whose measurements are not used.
        mapping: meaning of the columns, and treatment of repeated rows.
        sigma: least standard deviation of a reading along any axis [m].

    Raises:
        InputError: rows that repeat others, if the mapping does not allow them; names file and
            lines.
    """
    new = np.ones(len(rows), dtype=bool)
    if mapping.repeated == "keep":
        return new, []
    notes = []
    for k, row in enumerate(rows[1:], 1):
        new[k] = any(row.text[name] != rows[k - 1].text[name] for name in mapping.names)
        if not new[k] and mapping.repeated == "refuse":
            raise row.wrong(
                mapping.position[0].name,
                f"and the rest of this row repeats line {rows[k - 1].line} to the last digit; "
                f"{_WAYS.format('it', 'it')}",
            )
    if not new.all():
        notes.append(f"{np.sum(~new)} rows repeat the one before to the last digit: left out")
    copies, first = _copies(rows, np.flatnonzero(new & ~moves), mapping)
    if not copies:
        return new, notes
    repeat = "repeats" if len(copies) == 1 else "repeat"
    said = (
        f"{lines_of(rows, copies)} {repeat} {lines_of(rows, first)} to the last digit, commands "
        "and measurements"
    )
    if not mapping.stream and _by_chance(rows, first, new & ~moves, mapping, sigma):
        notes.append(f"{said}: with so few digits they can be equal by chance, so they were kept")
    elif mapping.repeated == "refuse":
        raise InputError(
            f"{rows[0].file}: {said}: a new measurement would differ by noise; "
            f"{_WAYS.format('them', 'them')}"
        )
    else:
        new[copies] = False
        notes.append(f"{said}: left out")
    return new, notes


def _copies(
    rows: Sequence[Row], among: NDArray[np.intp], mapping: TableMapping
) -> tuple[list[int], list[int]]:
    """Rows that repeat commands and measurements of an earlier row, and the earlier rows."""
    measured = _measured(mapping)
    seen: dict[Hashable, int] = {}
    pairs = [(k, seen.setdefault(_values(rows[k], measured), k)) for k in among.tolist()]
    return [k for k, first in pairs if k != first], [first for k, first in pairs if k != first]


def _measured(mapping: TableMapping) -> tuple[Column, ...]:
    """Columns that cannot all be equal in two measurements; the time is one in a stream."""
    turns = mapping.turn.columns if mapping.turn else ()
    time = (mapping.time,) if mapping.stream and mapping.time else ()
    return (*mapping.commands, *mapping.encoders, *mapping.position, *turns, *time)


def _values(row: Row, columns: Sequence[Column]) -> tuple[float | str, ...]:
    """Cells of a row as numbers, however they are written; other texts unchanged."""
    texts = [(row.text[column.name] or "").strip() for column in columns]
    return tuple(text if (value := number_of(text)) != value else value for text in texts)


def _by_chance(
    rows: Sequence[Row],
    first: Sequence[int],
    among: Mask,
    mapping: TableMapping,
    sigma: float,
) -> bool:
    """Whether rounding alone explains the number of equal rows with the same command."""
    said = [rows[k] for k in np.flatnonzero(among).tolist()]
    commands = Counter(_values(row, mapping.commands) for row in said)
    of_each = np.array([*commands.values()])
    of_copies = np.array([*Counter(first).values()]) + 1
    tries, equal = (int(np.sum(n * (n - 1) // 2)) for n in (of_each, of_copies))
    alike = float(np.prod([_alike(_step(said, c), sigma) for c in mapping.position]))
    return _at_least(equal, tries, alike) > _CHANCE


def _at_least(equal: int, tries: int, alike: float) -> float:
    """Binomial tail: probability of `equal` or more of `tries`, each with probability `alike`.

    `scipy.special.bdtrc` counts in 32 bits, and pairs of rows are more than that.
    """
    return float(betainc(equal, tries - equal + 1, alike))


def _step(rows: Sequence[Row], column: Column) -> float:
    """Step of the last digit in a column [m]."""
    last = min(_last_digit(row.text[column.name] or "") for row in rows)
    return float(10.0**last) * abs(column.factor)


def _last_digit(text: str) -> int:
    """Power of ten of the last digit of a number."""
    try:
        power = Decimal(text.strip()).as_tuple().exponent
    except InvalidOperation:
        return 0
    return power if isinstance(power, int) else 0


def _alike(step: float, sigma: float) -> float:
    """Probability that two readings of one value round to the same multiple of `step`."""
    x = step / (2 * sigma)
    return float(erf(x) + np.expm1(-(x**2)) / (x * np.sqrt(np.pi)))


def lines_of(rows: Sequence[Row], some: Sequence[int]) -> str:
    """Line numbers of rows in words, such as `lines 3 to 8, 12`; adjacent rows form a range."""
    places = sorted(set(some))
    runs: list[list[int]] = []
    for k in places:
        if runs and k == runs[-1][-1] + 1:
            runs[-1].append(k)
        else:
            runs.append([k])
    parts = [
        f"{rows[run[0]].line}" + (f" to {rows[run[-1]].line}" if len(run) > 1 else "")
        for run in runs
    ]
    more = f" and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    return f"line{'s' * (len(places) > 1)} {', '.join(parts[:_SHOWN])}{more}"
