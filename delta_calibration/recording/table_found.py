"""A table found in a file without being told how it is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.recording.table_source import Form, lines_of_file
from delta_calibration.texts import number_of

Array = NDArray[np.float64]
Lines = Sequence[tuple[int, list[str]]]

_DELIMITERS = (";", "\t", "|", ",", " ")
_FEWEST = 3  # numbers in a line of the table: joints alone, or points alone


@dataclass(frozen=True)
class FoundTable:
    """The cells of a table, as numbers where they are numbers.

    Attributes:
        form: how the file is written.
        names: of the columns; c1, c2, ... if no line of the file has them.
        named: whether a line of the file has them.
        number: (n, columns), NaN for texts.
        text: the same cells as texts.
        first: line of the file with the first row, from 1.
        join: section `join` of a mapping, if the table was put together from two files.
        notes: what a reader should know about how the table was found.
    """

    form: Form
    names: tuple[str, ...]
    named: bool
    number: Array
    text: tuple[tuple[str, ...], ...]
    first: int = 0
    join: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def column(self, name: str) -> Array:
        """Numbers of a column, (n,)."""
        return np.asarray(self.number[:, self.names.index(name)])

    def texts(self, name: str) -> tuple[str, ...]:
        """Texts of a column without blanks around them."""
        column = self.names.index(name)
        return tuple(row[column].strip() for row in self.text)

    def written(self) -> dict[str, Any]:
        """Section `table` of a mapping, without the delimiter."""
        form: dict[str, Any] = {}
        if self.form.decimal != ".":
            form["decimal"] = self.form.decimal
        if self.form.columns:
            form |= {"columns": list(self.form.columns), "first_line": self.form.first_line}
        return form


def found_table(path: Path) -> FoundTable:
    """The table in a file: cut so that most cells are numbers in lines of the same length.

    Raises:
        InputError: no such file, or no table in it.
    """
    tried = [(delimiter, decimal) for delimiter in _DELIMITERS for decimal in ".,"]
    best, most = None, 0
    for delimiter, decimal in tried:
        if delimiter != decimal:
            form = Form(delimiter, decimal)
            lines = lines_of_file(path, form)
            body = _body(lines, form)
            count = sum(_numbers(cells, form) for _, cells in lines[body[0] : body[1]])
            if count > most:
                best, most = (form, lines, body), count
    if best is None:
        raise InputError(f"{path}: no table in it: no lines of numbers in columns")
    form, lines, (first, last) = best
    width = len(lines[first][1])
    head = _head(lines[:first], form, width)
    names = (
        tuple(name.strip() for name in head) if head else tuple(f"c{k + 1}" for k in range(width))
    )
    if len(set(names)) != len(names) or not all(names):
        names, head = tuple(f"c{k + 1}" for k in range(width)), None
    rows = [cells for _, cells in lines[first:last] if len(cells) == width]
    number = np.array([[number_of(form.plain(cell)) for cell in cells] for cells in rows])
    if head is None:
        form = replace(form, columns=names, first_line=lines[first][0])
    text = tuple(map(tuple, rows))
    return FoundTable(form, names, head is not None, number, text, lines[first][0])


def _numbers(cells: Sequence[str], form: Form) -> int:
    return int(np.isfinite([number_of(form.plain(cell)) for cell in cells]).sum())


def _body(lines: Lines, form: Form) -> tuple[int, int]:
    """The longest run of lines of the same length with enough numbers in them."""
    best = begin = 0, 0
    for k, (_, cells) in enumerate(lines):
        good = _numbers(cells, form) >= _FEWEST
        same = begin[1] > begin[0] and len(lines[begin[0]][1]) == len(cells)
        begin = (begin[0], k + 1) if good and same else (k, k + int(good))
        best = max(best, begin, key=lambda run: run[1] - run[0])
    return best


def _head(before: Lines, form: Form, width: int) -> list[str] | None:
    """The last line before the numbers that has as many texts."""
    for _, cells in reversed(before):
        if len(cells) == width and _numbers(cells, form) == 0:
            return list(cells)
    return None
