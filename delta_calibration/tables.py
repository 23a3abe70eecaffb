"""Reads CSV tables of a user; errors name file, line and column."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delta_calibration.errors import InputError
from delta_calibration.texts import number_of, read_text

DELIMITERS = ";\t|,"

_HUGE = 1e30  # no quantity of a cell is so large in any unit; its square would overflow


@dataclass(frozen=True)
class Row:
    """A line of a CSV file."""

    file: Path
    line: int
    text: Mapping[str, str | None]  # by column name; None if the line is too short
    beside: Row | None = None  # row of a second file, whose columns are in `text` as well

    def number(self, column: str, least: float = -_HUGE, most: float = _HUGE) -> float:
        """The finite number in a column, within bounds.

        Raises:
            InputError: not a finite number, or out of bounds.
        """
        text = self.text[column] or ""
        value = number_of(text)
        if np.isnan(value):
            raise self.wrong(column, f"is not a finite number{_grouped(text)}")
        if not least <= value <= most:
            raise self.wrong(column, f"is not allowed; allowed: {least:g} to {most:g}")
        return value

    def wrong(self, column: str, problem: str) -> InputError:
        """Error about the value in a column, with file, line and value."""
        if self.beside is not None and column in self.beside.text:
            return self.beside.wrong(column, problem)
        text = self.text[column] or ""
        return InputError(f"{self.file}: line {self.line}: {column}: {text!r} {problem}")


def read_table(
    path: Path,
    columns: Sequence[str],
    optional: Sequence[str] = (),
    delimiter: str = ",",
) -> list[Row]:
    """Read the rows of a CSV file.

    Args:
        path: the file.
        columns: required columns.
        optional: optional columns.
        delimiter: character between two values.

    Raises:
        InputError: no such file, a column missing or twice, a line too long, or no row.
    """
    reader = csv.DictReader(
        io.StringIO(read_text(path), newline=""), delimiter=delimiter, skipinitialspace=True
    )
    try:
        found = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = found
        require_columns(path, found, columns, optional, delimiter)
        rows = [Row(path, reader.line_num, row) for row in _of_one_length(path, reader, found)]
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: {error}") from error
    if not rows:
        raise InputError(f"{path}: contains no points")
    return rows


def require_columns(
    path: Path,
    found: Sequence[str],
    columns: Sequence[str],
    optional: Sequence[str],
    delimiter: str,
) -> None:
    """Refuse a table in which a column is missing or exists twice.

    Raises:
        InputError: names the columns, those found, and the delimiter that the file seems to use.
    """
    missing = [name for name in columns if name not in found]
    if missing:
        other = next((mark for mark in DELIMITERS if len(found) == 1 and mark in found[0]), "")
        between = f"; {delimiter!r} is expected between two, not {other!r}" if other else ""
        raise InputError(
            f"{path}: column {', '.join(missing)} missing; expected "
            f"{', '.join((*columns, *optional))}, found {', '.join(found) or 'nothing'}{between}"
        )
    twice = [name for name in (*columns, *optional) if found.count(name) > 1]
    if twice:
        raise InputError(f"{path}: column {', '.join(twice)} is given twice")


def _grouped(text: str) -> str:
    """Hint how to write a number with separators between its digits; empty for other texts."""
    if not any(c.isdigit() for c in text) or any(c.isalpha() for c in text):
        return ""
    return "; use a decimal point and no thousands separator: -1234.5"


def _of_one_length(
    path: Path, reader: csv.DictReader[str], columns: Sequence[str]
) -> Iterator[dict[str, str]]:
    """Yield the rows; refuse one longer than the header: `1,5,2,5` is not 1.5 and 2.5."""
    for row in reader:
        surplus: Sequence[str] = row.pop(None, ())
        if surplus:
            raise InputError(
                f"{path}: line {reader.line_num}: {len(columns) + len(surplus)} values, but "
                f"{len(columns)} columns; use a decimal point, not a comma"
            )
        yield row
