"""Find the table in a file whose format is not known."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.recording.presets import presets
from delta_calibration.recording.table_source import Form, is_gap, lines_of_file, sheets_of
from delta_calibration.texts import number_of

Array = NDArray[np.float64]
Lines = Sequence[tuple[int, list[str]]]

_DELIMITERS = (";", "\t", "|", ",", " ")
_THOUSANDS = (".", ",", "'", " ")
_FEWEST = 3  # numbers in a line of the table at least: joints alone, or points alone
UNIT = (  # units as people write them, in brackets or bare
    r"urad|mrad|rad|radians?|deg|degrees?|grad|°|turns?|um|µm|mm|cm|m|inch|in|ms|us|"
    r"ns|s|sec|seconds?|min|minutes?|h|kg|g|degc|°c|k"
)
_WARMTH = r"(?:deg|°)?\s*[cf]|celsius|fahrenheit|kelvin"
_UNIT_CELL = re.compile(rf"[\[(]?\s*(?:{UNIT}|{_WARMTH})\s*[\])]?", re.IGNORECASE)


@dataclass(frozen=True)
class FoundTable:
    """The cells of a table, as numbers where they are numbers.

    Attributes:
        form: how the file is written.
        names: of the columns; c1, c2, ... if no line of the file names them.
        named: whether a line of the file names columns.
        number: (n, columns), NaN for texts.
        text: the same cells as texts.
        first: line of the file with the first row, from 1.
        ends: whether other lines, such as a mean, follow the rows.
        join: section `join` of a mapping, if the table was put together from two files.
        notes: what a reader should know about how the table was found.
    """

    form: Form
    names: tuple[str, ...]
    named: bool
    number: Array
    text: tuple[tuple[str, ...], ...]
    first: int = 0
    ends: bool = False
    join: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def column(self, name: str) -> Array:
        """Numbers of a column, (n,)."""
        return np.asarray(self.number[:, self.names.index(name)])

    def texts(self, name: str) -> tuple[str, ...]:
        """Texts of a column without surrounding blanks."""
        column = self.names.index(name)
        return tuple(row[column].strip() for row in self.text)

    def written(self) -> dict[str, Any]:
        """Section `table` of a mapping, without the delimiter."""
        form: dict[str, Any] = {}
        if self.form.decimal != ".":
            form["decimal"] = self.form.decimal
        if self.form.thousands:
            form["thousands"] = self.form.thousands
        if self.form.sheet:
            form["sheet"] = self.form.sheet
        if self.form.columns:
            form |= {"columns": list(self.form.columns), "first_line": self.form.first_line}
        return form


def found_table(path: Path, option: str = "--preset") -> FoundTable:
    """Find the table in a file: the format with most numbers in lines of equal length.

    Of a workbook it is the sheet with most numbers.

    Args:
        path: of the file.
        option: name of the option that takes a preset, for the message on a robot's program.

    Raises:
        InputError: no such file, a robot's program, or no table in it.
    """
    sheets = sheets_of(path)
    best = _best(path, _plain_forms(sheets), workbook=bool(sheets))
    if not sheets:
        best = _best(path, _grouped_forms(best), best)
        least = 0 if best is None else best.last - best.first
        for program in _programs(path, least):
            raise InputError(
                f"{path}: the table has the format of preset {program}: use {option} {program} "
                "instead of --guess"
            )
    if best is None:
        raise InputError(f"{path}: contains no table (no lines with columns of numbers)")
    form, lines, first, last = best.form, best.lines, best.first, best.last
    width = len(lines[first][1])
    names, there = _names([cells for _, cells in lines[:first]], form, width)
    rows = [cells for _, cells in lines[first:last] if len(cells) == width]
    number = np.array([[number_of(form.plain(cell)) for cell in cells] for cells in rows])
    named = any(names) or there
    if not there:
        names = tuple(name or f"c{k + 1}" for k, name in enumerate(names))
        form = replace(form, columns=names, first_line=lines[first][0])
    text = tuple(map(tuple, rows))
    return FoundTable(form, names, named, number, text, lines[first][0], last < len(lines))


def _programs(path: Path, least: int) -> Iterator[str]:
    """Presets of robot programs that match at least `least` rows of a file.

    `least` is the number of rows in its table, because a table may quote a line of a program.
    """
    for name, each in presets().items():
        if "pattern" in each["table"]:
            with suppress(InputError):
                if len(lines_of_file(path, Form.of({"preset": name}, ",", name))) >= least:
                    yield name


@dataclass(frozen=True)
class _Cut:
    """Lines of a file split into cells by a form, and the range of the table's rows in them."""

    form: Form
    lines: Lines
    first: int
    last: int
    numbers: int  # numeric cells in the rows


def _best(
    path: Path, forms: Iterable[Form], best: _Cut | None = None, *, workbook: bool = False
) -> _Cut | None:
    """Cut with the most numbers, the first one of equals; `best` if no form finds more."""
    for form in forms:
        lines = lines_of_file(path, form)
        if workbook:  # the lines of a workbook end with the last cell that is not empty
            width = max(len(cells) for _, cells in lines)
            lines = [(line, cells + [""] * (width - len(cells))) for line, cells in lines]
        first, last = _body(lines, form)
        count = sum(_numbers(cells, form) for _, cells in lines[first:last])
        if count > (0 if best is None else best.numbers):
            best = _Cut(form, lines, first, last, count)
    return best


def _plain_forms(sheets: Sequence[str]) -> Iterator[Form]:
    """Candidate forms: each sheet of a workbook or delimiter of a text, with each decimal mark."""
    for number, sheet in enumerate(sheets):
        yield Form(";", sheet=sheet if number else "")
        yield Form(";", ",", sheet=sheet if number else "")
    if not sheets:
        for delimiter, decimal in product(_DELIMITERS, ".,"):
            if delimiter != decimal:
                yield Form(delimiter, decimal)


def _grouped_forms(best: _Cut | None) -> Iterator[Form]:
    """Candidate forms of a text whose numbers have a separator between thousands."""
    delimiters = _DELIMITERS if best is None else (best.form.delimiter,)
    for delimiter, decimal, thousands in product(delimiters, ".,", _THOUSANDS):
        if len({delimiter, decimal, thousands}) == 3:
            yield Form(delimiter, decimal, thousands)


def _numbers(cells: Sequence[str], form: Form) -> int:
    return int(np.isfinite([number_of(form.plain(cell)) for cell in cells]).sum())


def _body(lines: Lines, form: Form) -> tuple[int, int]:
    """Range of the longest run of lines of equal length that hold numbers, or mostly gaps."""
    best = begin = 0, 0
    for k, (_, cells) in enumerate(lines):
        good = _numbers(cells, form) >= _FEWEST
        same = begin[1] > begin[0] and len(lines[begin[0]][1]) == len(cells)
        more = same and (good or 2 * sum(map(is_gap, cells)) >= len(cells))
        begin = (begin[0], k + 1) if more else (k, k + int(good))
        best = max(best, begin, key=lambda run: run[1] - run[0])
    return best


def _names(
    before: Sequence[Sequence[str]], form: Form, width: int
) -> tuple[tuple[str, ...], bool]:
    """Names of the columns, and whether one line of the file has exactly these names.

    They are in the last line before the numbers that has as many cells and no number; a line of
    units may follow it. A missing name is empty; of equal names the later ones are numbered.
    """
    heads = [cells for cells in before if len(cells) == width and not _numbers(cells, form)]
    if not heads:
        return ("",) * width, False
    head, units = [name.strip() for name in heads[-1]], [""] * width
    if len(heads) > 1 and all(is_gap(c) or _UNIT_CELL.fullmatch(c.strip()) for c in head):
        head, units = [name.strip() for name in heads[-2]], [unit.strip("[]() ") for unit in head]
    names: list[str] = []
    for name, unit in zip(head, units, strict=True):
        whole = f"{name} [{unit}]" if name and unit else name
        known = names.count(whole) if whole else 0
        names.append(f"{whole} ({known + 1})" if known else whole)
    return tuple(names), all(names) and names == [name.strip() for name in heads[-1]]
