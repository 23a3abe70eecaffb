"""Export of a report's numbers: one JSON file for all, one CSV file for each figure and table."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from delta_calibration.errors import InputError
from delta_calibration.report.document import Report
from delta_calibration.report.drawing import Bars, Field, Figure, Line, Mark, Panel, Points, Rule
from delta_calibration.wording import NO_VALUE, plain

Row = tuple[object, ...]
_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?(e[+-]\d+)?")
_POWER_ALONE = re.compile("10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_HEAD = ("panel", "series", "x", "y", "value", "low", "high")


def write_numbers(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write `report.json` and the CSV files into a folder, which is created if necessary.

    Raises:
        InputError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        whole = folder / "report.json"
        text = json.dumps(as_json(report), indent=1, allow_nan=False, ensure_ascii=False)
        whole.write_text(text + "\n", encoding="utf-8")
        paths = [whole]
        for table in report.tables():
            head = [name or f"column {k}" for k, name in enumerate(table.head, 1)]
            rows = (tuple(map(cell, row)) for row in table.rows)
            paths.append(_write(folder / f"{table.name}.csv", head, rows))
        for figure in report.figures():
            paths.append(_write(folder / f"{figure.name}.csv", _HEAD, rows_of(figure)))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from error
    return tuple(paths)


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(rows)
    return path


def cell(text: str) -> str:
    """Convert a table cell for other programs: plain numbers, empty if there is no value.

    Percentages become numbers from 0 to 1; a bound (< 10^-300, > 99.9 %) is written as its value.
    """
    if text == NO_VALUE:
        return ""
    bare = plain(text.removeprefix("< ").removeprefix("> "))
    if (power := _POWER_ALONE.fullmatch(text.removeprefix("< "))) is not None:
        bare = plain(f"1 × {power[0]}")
    share = bare.endswith(" %")
    number = bare.removesuffix(" %").replace(" ", "")
    if _NUMBER.fullmatch(number) is None:
        return plain(text)
    return f"{float(number) / 100:.6g}" if share else number.removeprefix("+")


def as_json(report: Report) -> dict[str, Any]:
    """Convert a report to plain data; the numbers of figures are not rounded."""
    return {
        "schema": 1,
        "title": report.title,
        "sentence": report.sentence,
        "statements": {s.question: s.answer for s in report.statements},
        **report.data,
        "tables": {
            t.name: {"title": t.title, "head": list(t.head), "rows": [list(r) for r in t.rows]}
            for t in report.tables()
        },
        "figures": {
            f.name: {
                "title": f.title,
                "axes": {p.title: {"x": p.x.title, "y": p.y.title} for p in f.panels},
                "columns": list(_HEAD),
                "rows": [list(row) for row in rows_of(f)],
            }
            for f in report.figures()
        },
    }


def rows_of(figure: Figure) -> Iterator[Row]:
    """One row for each sample: panel, series, x, y, field value, ends of a band or error bar."""
    for panel in figure.panels:
        for mark in panel.marks:
            for row in _of_mark(panel, mark):
                yield (panel.title, mark.name, *row)


def _of_mark(panel: Panel, mark: Mark) -> Iterator[Row]:
    match mark:
        case Field():
            for i, j in zip(*np.nonzero(np.isfinite(mark.value)), strict=True):
                yield _row(mark.x[j], mark.y[i], mark.value[i, j])
        case Rule():
            yield _row(*((mark.value, None) if mark.upright else (None, mark.value)))
        case Bars():
            for place, length in zip(mark.place, mark.length, strict=True):
                yield (_number(length), panel.y.names[int(place)], None, None, None)
        case Points():
            error = np.full(len(mark.x), np.nan) if mark.error is None else mark.error
            middle = mark.x if panel.y.names else mark.y
            for x, y, low, high in zip(
                mark.x, mark.y, middle - error, middle + error, strict=True
            ):
                named = panel.y.names[int(y)] if panel.y.names else _number(y)
                yield (_number(x), named, None, _number(low), _number(high))
        case Line():
            nothing = np.full(len(mark.x), np.nan)
            low = nothing if mark.low is None else mark.low
            high = nothing if mark.high is None else mark.high
            for x, y, a, b in zip(mark.x, mark.y, low, high, strict=True):
                yield _row(x, y, None, a, b)


def _row(*values: float | None) -> Row:
    numbers = [_number(v) for v in values]
    return (*numbers, *[None] * (5 - len(numbers)))


def _number(value: float | None) -> float | None:
    """Python float of a value; None if it is missing or not finite."""
    return None if value is None or not np.isfinite(value) else float(value)
