"""Join two found tables: a robot's log and an instrument's export."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from os.path import relpath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.recording.presets import Other
from delta_calibration.recording.table_found import FoundTable
from delta_calibration.recording.table_mapping import TIMES
from delta_calibration.recording.table_names import CLOCK, MEANT, bare_name

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]  # (k, 2), rows of the first and of the second table

_SHARED = 0.5  # of the shorter table's rows: least number of common texts, to join by names
_CLOCK = re.compile(rf"({CLOCK})$")
_SECOND = " (2)"  # suffix of a column's name that the first table has as well


def paired(
    left: FoundTable, right: FoundTable, path: Path, other: Other, beside: Path
) -> FoundTable:
    """Join two tables by names, by row or by the nearest time.

    Args:
        left: the first table.
        right: the second one.
        path: file of the first.
        other: file of the second and how rows are joined (`by`; empty to find it).
        beside: file of the mapping, to which the path of the second file is relative.

    Raises:
        InputError: the rows cannot be joined in this way, or in any if `by` is empty.
    """
    right = _distinct(left, right)
    ways = {"name": _by_name, "row": _by_row, "nearest": _by_nearest}
    for by in [other.by] if other.by else ways:
        found = ways[by](left, right, other)
        if found is not None:
            rows, join, how = found
            note = f"{len(rows)} rows of {path.name} and {other.file.name} joined by {how}"
            file = relpath(other.file.absolute(), beside.absolute().parent)
            return _joined(left, right, rows, {"file": file, **join, **_form(right)}, note)
    columns = " and ".join(", ".join(table.names) for table in (left, right))
    raise InputError(
        f"{path} and {other.file}: rows cannot be matched by {other.by or 'name, row or time'}: "
        f"{len(left.text)} and {len(right.text)} rows; columns {columns}"
        f"{_how_far(left, right, other)}{_first_rows(left, right, other)}"
    )


def _first_rows(left: FoundTable, right: FoundTable, other: Other) -> str:
    """Hint for joining by row if one table is longer than the other, else empty."""
    short = min(len(left.text), len(right.text))
    if other.by not in ("", "row") or len(left.text) == len(right.text):
        return ""
    return (
        f"; if the first {short} rows of both belong together, save those rows of the longer "
        "table as a separate file"
    )


_Found = tuple[Pairs, dict[str, Any], str] | None


def _by_name(left: FoundTable, right: FoundTable, _: Other) -> _Found:
    """Join by the two columns with most texts in common, each text once in its column."""
    best: _Found = None
    for ours, theirs in product(_keys(left), _keys(right)):
        place = {text: k for k, text in enumerate(right.texts(theirs))}
        rows = [(k, place[text]) for k, text in enumerate(left.texts(ours)) if text in place]
        enough = _SHARED * min(len(left.text), len(right.text))
        if len(rows) > max(enough, 0 if best is None else len(best[0])):
            join = {"by": "column", "left": ours, "right": theirs}
            best = np.array(rows), join, f"columns {ours} and {theirs}"
    return best


def _keys(table: FoundTable) -> Iterator[str]:
    """Columns that can be keys: a different text in every row, and no numbers with decimals."""
    for name in table.names:
        texts, number = table.texts(name), table.column(name)
        whole = np.isnan(number) | (number == np.round(number))
        if len(set(texts)) == len(texts) and all(texts) and whole.all():
            yield name


def _by_row(left: FoundTable, right: FoundTable, _: Other) -> _Found:
    if len(left.text) != len(right.text):
        return None
    return np.repeat(np.arange(len(left.text))[:, None], 2, axis=1), {"by": "row"}, "row"


def _by_nearest(left: FoundTable, right: FoundTable, other: Other) -> _Found:
    """Join by numeric times: each row with the row of the other table that is nearest in time."""
    times = _times(left, right)
    if times is None:
        return None
    _require_one_unit(times, other)
    ours, theirs = times[0].of(left), times[1].of(right) + other.shift
    near = np.abs(theirs[:, None] - ours).argmin(axis=0)
    rows = np.flatnonzero(np.abs(theirs[near] - ours) <= other.within)
    if not rows.size:
        return None
    names, unit = (times[0].column, times[1].column), times[0].unit
    join = {"by": "nearest", "left": names[0], "right": names[1], "within": other.within / unit}
    if other.shift:
        join["shift"] = other.shift / unit
    return np.stack([rows, near[rows]], axis=1), join, f"the nearest {names[0]} and {names[1]}"


@dataclass(frozen=True)
class _Clock:
    """A column of times as numbers."""

    column: str
    unit: float  # [s]

    def of(self, table: FoundTable) -> Array:
        """Its times, (n,) [s]."""
        return self.unit * table.column(self.column)


def _times(left: FoundTable, right: FoundTable) -> tuple[_Clock, _Clock] | None:
    """Numeric time columns of both tables; None if one of them has none."""
    ours, theirs = (next(_clocks(table), None) for table in (left, right))
    return (ours, theirs) if ours and theirs else None


def _clocks(table: FoundTable) -> Iterator[_Clock]:
    for name in table.names:
        bare, unit = bare_name(name.removesuffix(_SECOND))
        if _CLOCK.match(bare) and np.isfinite(table.column(name)).all():
            yield _Clock(name, TIMES.get(unit or MEANT.get(bare, "s"), 1.0))


def _require_one_unit(times: tuple[_Clock, _Clock], other: Other) -> None:
    """Refuse times in two units, because rows are compared as they are written.

    Raises:
        InputError: the units differ.
    """
    if times[0].unit != times[1].unit:
        raise InputError(
            f"{other.file}: column {times[1].column} is in another unit than "
            f"{times[0].column} of the first file: convert one of them to join rows by time"
        )


def _how_far(left: FoundTable, right: FoundTable, other: Other) -> str:
    """Hint for joining by time (--within, --shift) if both tables have times, else empty."""
    times = _times(left, right)
    if times is None:
        return ""
    ours, theirs = times[0].of(left), times[1].of(right) + other.shift
    gap = np.abs(theirs[:, None] - ours).min(axis=1)
    return (
        f". By time, a row of {other.file.name} is {np.median(gap):.3g} s (median) from the "
        f"nearest of the other file, and --within allows {other.within:g} s; times run from "
        f"{ours.min():.7g} to {ours.max():.7g} s and from {theirs.min():.7g} to "
        f"{theirs.max():.7g} s: raise --within, or move the second clock by --shift"
    )


def _distinct(left: FoundTable, right: FoundTable) -> FoundTable:
    """Second table, with its columns renamed whose names the first table has as well."""
    if not set(left.names) & set(right.names):
        return right
    names = tuple(f"{name}{_SECOND}" if name in left.names else name for name in right.names)
    form = replace(right.form, columns=names, first_line=right.first)
    return replace(right, names=names, form=form)


def _form(table: FoundTable) -> dict[str, Any]:
    delimiter = {} if table.form.delimiter == "," else {"delimiter": table.form.delimiter}
    return {**delimiter, **({"table": table.written()} if table.written() else {})}


def _joined(
    left: FoundTable, right: FoundTable, rows: Pairs, join: dict[str, Any], note: str
) -> FoundTable:
    text: Sequence[tuple[str, ...]] = [left.text[i] + right.text[j] for i, j in rows]
    number = np.hstack([left.number[rows[:, 0]], right.number[rows[:, 1]]])
    return replace(
        left,
        names=left.names + right.names,
        named=left.named and right.named,
        number=number,
        text=tuple(text),
        join=join,
        notes=(note,),
    )
