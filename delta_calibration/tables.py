"""CSV tables of a user: their lines, and what is wrong with one by its place in the file."""

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

_HUGE = 1e30  # in no unit is anything of a cell so large; what is would overflow when squared


@dataclass(frozen=True)
class Row:
    """A line of a CSV file."""

    file: Path
    line: int
    text: Mapping[str, str | None]  # by the names of the columns; None where the line is short
    beside: Row | None = None  # of a second file, whose columns are in `text` as well

    def number(self, column: str, least: float = -_HUGE, most: float = _HUGE) -> float:
        """The finite number in a column, between bounds.

        Raises:
            InputError: another text, or a number that is not allowed.
        """
        text = self.text[column] or ""
        value = number_of(text)
        if np.isnan(value):
            raise self.wrong(column, f"is not a finite number{_grouped(text)}")
        if not least <= value <= most:
            raise self.wrong(column, f"is not allowed; allowed: {least:g} to {most:g}")
        return value

    def wrong(self, column: str, problem: str) -> InputError:
        """What is wrong with the value in a column."""
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
    """The lines of a CSV file.

    Args:
        path: the file.
        columns: that it has to have.
        optional: that it may have.
        delimiter: between two values.

    Raises:
        InputError: no such file, a column missing or there twice, a line too long, or no line.
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
        raise InputError(f"{path}: no points in it")
    return rows


def require_columns(
    path: Path,
    found: Sequence[str],
    columns: Sequence[str],
    optional: Sequence[str],
    delimiter: str,
) -> None:
    """Refuse columns that are missing or there twice.

    Raises:
        InputError: names them, what is there, and the delimiter that it looks like.
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
        raise InputError(f"{path}: column {', '.join(twice)} is there twice")


def _grouped(text: str) -> str:
    """What to write instead of digits that are separated by something."""
    if not any(c.isdigit() for c in text) or any(c.isalpha() for c in text):
        return ""
    return "; decimals take a point, thousands take nothing: -1234.5"


def _of_one_length(
    path: Path, reader: csv.DictReader[str], columns: Sequence[str]
) -> Iterator[dict[str, str]]:
    """The rows, none longer than the header: `1,5,2,5` is not 1.5 and 2.5."""
    for row in reader:
        surplus: Sequence[str] = row.pop(None, ())
        if surplus:
            raise InputError(
                f"{path}: line {reader.line_num}: {len(columns) + len(surplus)} values, but "
                f"{len(columns)} columns; decimals take a point, not a comma"
            )
        yield row
