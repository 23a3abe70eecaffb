"""Tables as programs write them: encodings, preambles, decimal commas, workbooks, two files.

The result is always rows with plain numbers (`tables.Row`), whatever the format of the file.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from charset_normalizer import from_bytes

from delta_calibration.errors import ConfigError, InputError
from delta_calibration.files import MOST_TEXT, read_bounded
from delta_calibration.recording.presets import preset
from delta_calibration.tables import Row, require_columns
from delta_calibration.texts import listed

_WORKBOOK = b"PK\x03\x04"
_ARRAYS = (".npy", ".npz", ".mat")  # files of arrays; a .mat file may be a text, too
_MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
# encodings of instruments and their computers; the first that fits is not always the likeliest
_LIKELY = ["utf_16_le", "utf_16_be", "cp1252", "gb18030", "shift_jis", "euc_kr"]
_MOST_ROWS, _MOST_CELLS = 1 << 20, 50_000_000  # of a sheet, including empty ones in between
_PREAMBLE = 200  # lines that may stand before the names of the columns
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_WITH_POINT = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_GAPS = ("", "nan", "na", "n/a", "#n/a", "null", "none")  # as programs write them


@dataclass(frozen=True)
class Form:
    """How a table is written.

    Attributes:
        delimiter: between two values.
        decimal: `.` or `,`.
        thousands: separator between thousands; empty if there is none.
        encoding: of the text; empty to detect it.
        header_line: line with the names of the columns, from 1; 0 to find it by the names.
        columns: their names if no line has them.
        sheet: of a workbook; its first one if empty.
        comment: prefix of comment lines, which are skipped; empty if there are none.
        first_line: line in which the numbers begin, from 1, if `columns` are given.
        more: whether further columns, after those of `columns`, are left out.
        pattern: regular expression of a row, if the file is no table: each group is a column.
        either: whether decimals may have a comma, as a program follows its computer's settings.
    """

    delimiter: str = ","
    decimal: str = "."
    thousands: str = ""
    encoding: str = ""
    header_line: int = 0
    columns: tuple[str, ...] = ()
    sheet: str = ""
    comment: str = ""
    first_line: int = 0
    more: bool = False
    pattern: str = ""
    either: bool = False

    @classmethod
    def of(cls, entry: Mapping[str, Any], delimiter: str, where: str) -> Form:
        """Form described by section `table` of a mapping.

        Raises:
            ConfigError: the same mark for decimals and thousands or columns, or keys that exclude
                each other.
        """
        own = {"delimiter": delimiter, **entry}
        if "preset" in entry:
            own |= preset(own.pop("preset"))["table"]
            own["either"] = "decimal" not in own
        if "pattern" in own:
            own["columns"] = tuple(re.compile(own["pattern"]).groupindex)
        form = cls(**{**own, "columns": tuple(own.get("columns", ()))})
        if form.decimal == form.thousands or form.decimal == form.delimiter:
            other = "thousands" if form.decimal == form.thousands else "delimiter"
            raise ConfigError(
                f"{where}: decimal {form.decimal!r} is not allowed with {other} {form.decimal!r}"
            )
        if form.columns and form.header_line:
            raise ConfigError(
                f"{where}: header_line is for files that contain the column names, "
                "without `columns`"
            )
        if form.first_line and not form.columns:
            raise ConfigError(
                f"{where}: first_line is for files without a line of column names; it "
                "needs `columns`"
            )
        return form

    @property
    def number(self) -> re.Pattern[str]:
        """Pattern of a number with this form's decimal mark and separator of thousands."""
        parted = rf"\d{{1,3}}(?:{re.escape(self.thousands)}\d{{3}})+|" if self.thousands else ""
        mark = re.escape(self.decimal)
        return re.compile(rf"[+-]?(?:{parted}\d+)?(?:{mark}\d*)?(?:[eE][+-]?\d+)?")

    def plain(self, text: str) -> str:
        """Cell with its number written plainly; unchanged if it holds no number."""
        bare = text.strip().replace("\u2212", "-")
        if self.number.fullmatch(bare) is None:
            return text
        if self.thousands:
            bare = bare.replace(self.thousands, "")
        return bare.replace(self.decimal, ".")


@dataclass(frozen=True)
class Join:
    """Second table and how its rows are joined to those of the first.

    Attributes:
        file: of the second table.
        by: `row`, `column` or `nearest`.
        left: column of the first table that is compared, unless joined by row.
        right: column of the second table that is compared with it.
        within: [the columns' unit] largest difference to the nearest value.
        shift: [the columns' unit] added to the values of the second table, such as its clock.
        form: how the second table is written.
    """

    file: Path
    by: str
    left: str = ""
    right: str = ""
    within: float = 0.0
    shift: float = 0.0
    form: Form = field(default_factory=Form)


@dataclass(frozen=True)
class Source:
    """Rows of a table, with notes on how they were read."""

    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()


def read_source(path: Path, names: Sequence[str], form: Form, join: Join | None) -> Source:
    """Read the rows of one table, or of two joined ones.

    Args:
        path: of the table.
        names: columns that one of the files has to have.
        form: how it is written.
        join: the second table; None if there is none.

    Raises:
        InputError: no such file, a column missing, in both files or there twice, a line too long,
            no line, rows that cannot be joined; names file and line.
    """
    if join is None:
        return _read(path, names, form, names)
    left = _read(path, names, form, [join.left] * bool(join.left))
    right = _read(join.file, names, join.form, [join.right] * bool(join.right))
    _require_all(left, right, names, path, join)
    rows, notes = _joined(left.rows, right.rows, join, path)
    return Source(rows, (*left.notes, *right.notes, *notes))


def _read(path: Path, names: Sequence[str], form: Form, needed: Sequence[str]) -> Source:
    """Rows of one file, which may have the columns `names` and must have those in `needed`."""
    lines, notes = _lines(path, form)
    head = -1 if form.columns else _header(lines, names, form, path)
    found = list(form.columns) if form.columns else [name.strip() for name in lines[head][1]]
    if head > 0 and not form.header_line:
        notes = (*notes, f"{path.name}: the column names were found in line {lines[head][0]}")
    require_columns(path, found, needed, (), form.delimiter)
    twice = sorted({name for name in names if found.count(name) > 1})
    if twice:
        raise InputError(f"{path}: column {', '.join(twice)} is given twice")
    form, said = _by_marks(form, _mapped(lines[head + 1 :], found, names), path)
    notes = (*notes, *said)
    rows = tuple(_row(path, line, cells, found, form) for line, cells in lines[head + 1 :])
    if not rows:
        raise InputError(f"{path}: contains no points")
    return Source(rows, notes)


def _mapped(
    lines: Sequence[tuple[int, list[str]]], found: Sequence[str], names: Sequence[str]
) -> list[str]:
    """Cells of the wanted columns only, because a point's name may be `1.2` or `1,2`."""
    return [
        cell.strip()
        for _, cells in lines
        for name, cell in zip(found, cells, strict=False)
        if name in names
    ]


def _by_marks(form: Form, cells: Sequence[str], path: Path) -> tuple[Form, tuple[str, ...]]:
    """Form with decimal commas and a note of it, if they are allowed and found in the cells.

    `1,234` alone may be a thousand, and a comma is no decimal mark if another number has a point.
    """
    if not form.either or form.delimiter == ",":
        return form, ()
    commas = [cell for cell in cells if _WITH_COMMA.fullmatch(cell)]
    if all(_THOUSANDS.fullmatch(cell) for cell in commas) or any(
        map(_WITH_POINT.fullmatch, cells)
    ):
        return form, ()
    said = f"{path.name}: decimals have a comma in it ({commas[0]})"
    return replace(form, decimal=","), (said,)


def _lines(path: Path, form: Form) -> tuple[list[tuple[int, list[str]]], tuple[str, ...]]:
    """Lines that are not empty, with their line numbers, from the form's first line on."""
    data = _data(path)
    notes: tuple[str, ...] = ()
    if data.startswith(_WORKBOOK):
        lines = list(_sheet(path, data, form))
    elif form.sheet:
        raise InputError(
            f"{path}: sheet {form.sheet!r} of the mapping: the file is a text, not a workbook"
        )
    else:
        text, notes = _text(path, data, form)
        lines = list(_matches(path, text, form) if form.pattern else _cut(path, text, form))
        _require_points(path, form, lines)
    lines = [line for line in lines if line[0] >= form.first_line]
    if form.more:
        lines = [(line, cells[: len(form.columns)]) for line, cells in lines]
    if not lines:
        raise InputError(f"{path}: contains no points")
    return lines, notes


def _data(path: Path) -> bytes:
    """Content of a table's file.

    Raises:
        InputError: no such file, or arrays of numpy or MATLAB.
    """
    data = read_bounded(path)
    if path.suffix.lower() in _ARRAYS and (data.startswith(_WORKBOOK) or b"\0" in data):
        raise InputError(
            f"{path}: {path.suffix} is no table that can be read; a text (such as CSV) or an xlsx "
            "file is expected: save the columns as CSV, with their names in the first line"
        )
    return data


def _require_points(path: Path, form: Form, lines: Sequence[tuple[int, list[str]]]) -> None:
    """Refuse a file whose commas may separate both decimals and columns.

    `P1,2788,6823,-518,7024` would be read as a point in whole millimetres with further columns,
    which are left out.
    """
    rows = [(line, cells) for line, cells in lines if line >= form.first_line]
    if not (form.either and form.more and form.delimiter == "," and rows):
        return
    longer = all(len(cells) > len(form.columns) for _, cells in rows)
    if longer and not any(_WITH_POINT.fullmatch(cell.strip()) for _, row in rows for cell in row):
        line, cells = rows[0]
        raise InputError(
            f"{path}: line {line}: {len(cells)} values, but {len(form.columns)} columns, and no "
            "decimal point in the file: does it use commas both for decimals and between "
            "columns? Export it with decimal points, or with another separator between columns"
        )


def lines_of_file(path: Path, form: Form) -> list[tuple[int, list[str]]]:
    """Lines of a table split into cells by a form, with their line numbers.

    Raises:
        InputError: no such file, or nothing in it.
    """
    return _lines(path, form)[0]


def sheets_of(path: Path) -> list[str]:
    """Names of the sheets of a workbook; empty for a text file.

    Raises:
        InputError: no such file, or a workbook that cannot be read.
    """
    data = _data(path)
    return list(_workbook(path, data)) if data.startswith(_WORKBOOK) else []


def is_gap(cell: str | None) -> bool:
    """Whether a cell is empty, or says that there is no value."""
    return (cell or "").strip().lower() in _GAPS


def _cut(path: Path, text: str, form: Form) -> Iterator[tuple[int, list[str]]]:
    """Lines of a text split at the delimiter, without comment lines."""
    stream = io.StringIO(text, newline="")
    reader = csv.reader(stream, delimiter=form.delimiter, skipinitialspace=True)
    try:
        for cells in reader:
            comment = form.comment and cells and cells[0].startswith(form.comment)
            if any(cell.strip() for cell in cells) and not comment:
                yield reader.line_num, cells
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: {error}") from error


def _matches(path: Path, text: str, form: Form) -> Iterator[tuple[int, list[str]]]:
    """Rows of a program's text that match the form's pattern, each with its first line number."""
    matches = list(re.finditer(form.pattern, text, re.IGNORECASE))
    line, end = 1, 0
    for match in matches:
        line += text.count("\n", end, match.start())
        end = match.start()
        yield line, [match[name] or "" for name in form.columns]
    if not matches:
        raise InputError(f"{path}: nothing in the file has the format of the preset")


def _text(path: Path, data: bytes, form: Form) -> tuple[str, tuple[str, ...]]:
    """Decoded text of a file, with a note if its encoding had to be detected."""
    known = form.encoding or next(
        (name for mark, name in _MARKS if data.startswith(mark)), "utf-8"
    )
    try:
        text = data.decode(known)
        if "\0" not in text:
            return text, ()
    except (UnicodeDecodeError, LookupError) as error:
        if form.encoding:
            raise InputError(f"{path}: is not in {form.encoding}: {error}") from error
    best = from_bytes(data, cp_isolation=_LIKELY).best()
    if best is None or "\0" in str(best):
        raise InputError(f"{path}: no known encoding fits; set table.encoding in the mapping")
    said = (
        f"{path.name}: its encoding was detected as {best.encoding}; to use another one, set "
        "table.encoding in the mapping"
    )
    return str(best), (said,)


def _sheet(path: Path, data: bytes, form: Form) -> Iterator[tuple[int, list[str]]]:
    """Rows of a workbook's sheet, with all digits of the numbers."""
    sheets = _workbook(path, data)
    if form.sheet and form.sheet not in sheets:
        raise InputError(f"{path}: no sheet {form.sheet!r}; choose from: {listed(list(sheets))}")
    sheet = sheets[form.sheet] if form.sheet else next(iter(sheets.values()))
    return _rows_of(path, sheet)


def _workbook(path: Path, data: bytes) -> dict[str, Any]:
    """The sheets of a workbook by their names."""
    try:
        from openpyxl import load_workbook
    except ImportError as error:
        raise InputError(
            f"{path}: a workbook needs openpyxl, which this Python does not have: "
            "pip install openpyxl, or export a text file (CSV)"
        ) from error
    try:
        with ZipFile(io.BytesIO(data)) as archive:  # ZipFile unpacks no more than is declared
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MOST_TEXT:
            raise InputError(
                f"{path}: unpacks to {size} bytes; {MOST_TEXT} are allowed: export a text file"
            )
        book = load_workbook(io.BytesIO(data), read_only=True, data_only=True)
    except InputError:
        raise
    except Exception as error:  # a damaged or renamed archive fails in many ways
        raise InputError(f"{path}: is not a workbook (xlsx): {error}") from error
    sheets = {sheet.title: sheet for sheet in book.worksheets}
    if not sheets:
        raise InputError(f"{path}: has no sheet with cells")
    return sheets


def _rows_of(path: Path, sheet: Any) -> Iterator[tuple[int, list[str]]]:
    """Rows of a sheet that are not empty, each with its number."""
    rows, size = sheet.iter_rows(values_only=True), 0
    for number in count(1):
        try:
            row = next(rows, None)
        except Exception as error:  # rows are parsed one by one, and any may be bad
            raise InputError(f"{path}: line {number} cannot be read: {error}") from error
        if row is None:
            return
        size += len(row)
        if number > _MOST_ROWS or size > _MOST_CELLS:
            raise InputError(
                f"{path}: has more than {_MOST_ROWS} lines or {_MOST_CELLS} cells; export the "
                "part you need to a text file"
            )
        cells = ["" if value is None else _cell(value) for value in row]
        while cells and not cells[-1]:
            cells.pop()
        if cells:
            yield number, cells


def _cell(value: Any) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def _header(
    lines: Sequence[tuple[int, list[str]]], names: Sequence[str], form: Form, path: Path
) -> int:
    """Index of the line with the column names: the stated one, or that with most wanted names."""
    if form.header_line:
        rows = [k for k, (line, _) in enumerate(lines) if line == form.header_line]
        if not rows:
            raise InputError(f"{path}: header_line {form.header_line}: this line is empty")
        return rows[0]
    found = [len(set(names) & {cell.strip() for cell in cells}) for _, cells in lines[:_PREAMBLE]]
    return int(np.argmax(found))


def _row(path: Path, line: int, cells: list[str], names: Sequence[str], form: Form) -> Row:
    """Row of a line; more cells than columns are refused: `1,5,2,5` is not 1.5 and 2.5."""
    if len(cells) > len(names):
        raise InputError(
            f"{path}: line {line}: {len(cells)} values, but {len(names)} columns; use a decimal "
            "point, not a comma (or set table.decimal and delimiter in the mapping)"
        )
    plain = (
        [form.plain(cell) for cell in cells] if form.decimal != "." or form.thousands else cells
    )
    text: dict[str, str | None] = dict.fromkeys(names)
    return Row(path, line, text | dict(zip(names, plain, strict=False)))


# --- two files


def _require_all(
    left: Source, right: Source, names: Sequence[str], path: Path, join: Join
) -> None:
    in_left, in_right = (set(source.rows[0].text) for source in (left, right))
    missing = [name for name in names if name not in in_left | in_right]
    if missing:
        raise InputError(
            f"{path}, {join.file}: column {', '.join(missing)} missing; found "
            f"{', '.join(sorted(in_left))} and {', '.join(sorted(in_right))}"
        )
    both = [name for name in names if name in in_left & in_right]
    if both:
        raise InputError(
            f"{path}, {join.file}: column {', '.join(both)} is in both; rename the columns of "
            "one with `columns` in the mapping"
        )


def _joined(
    left: Sequence[Row], right: Sequence[Row], join: Join, path: Path
) -> tuple[tuple[Row, ...], tuple[str, ...]]:
    partner = {"row": _by_row, "column": _by_column, "nearest": _by_nearest}[join.by](
        left, right, join, path
    )
    rows = tuple(
        replace(row, text={**right[k].text, **row.text}, beside=right[k])
        for row, k in zip(left, partner, strict=True)
        if k is not None
    )
    alone = sum(k is None for k in partner)
    if not rows:
        raise InputError(
            f"{path}: none of its {len(left)} rows has a partner in {join.file} (by {join.by})"
        )
    told = (
        f"{alone} of {len(left)} rows of {path.name} have no partner in {join.file.name} and "
        "were left out"
    )
    return rows, (told,) * bool(alone)


def _by_row(left: Sequence[Row], right: Sequence[Row], join: Join, path: Path) -> list[int | None]:
    if len(left) != len(right):
        raise InputError(
            f"{path} has {len(left)} rows, {join.file} {len(right)}: joining row by row needs "
            "equal numbers; with join.by column or nearest, a column of each is used"
        )
    return list(range(len(right)))


def _by_column(
    left: Sequence[Row], right: Sequence[Row], join: Join, path: Path
) -> list[int | None]:
    del path
    known: dict[str, int] = {}
    for k, row in enumerate(right):
        text = (row.text[join.right] or "").strip()
        if known.setdefault(text, k) != k:
            raise row.wrong(join.right, f"is in line {right[known[text]].line} as well")
    return [known.get((row.text[join.left] or "").strip()) for row in left]


def _by_nearest(
    left: Sequence[Row], right: Sequence[Row], join: Join, path: Path
) -> list[int | None]:
    """Row of the second table that is nearest by a number; none may be nearest to two rows."""
    del path
    ours = np.array([row.number(join.left) for row in left])
    theirs = np.array([row.number(join.right) for row in right]) + join.shift
    order = np.argsort(theirs, kind="stable")
    after = np.clip(np.searchsorted(theirs[order], ours), 1, max(len(order) - 1, 1))
    near = np.stack([order[after - 1], order[np.minimum(after, len(order) - 1)]])
    gap = np.abs(theirs[near] - ours)
    best = np.where(gap[0] <= gap[1], near[0], near[1])
    found = [
        int(k) if g <= join.within else None for k, g in zip(best, gap.min(axis=0), strict=True)
    ]
    first: dict[int, Row] = {}
    for row, k in zip(left, found, strict=True):
        if k is not None and first.setdefault(k, row) is not row:
            raise row.wrong(
                join.left,
                f"and {first[k].text[join.left]!r} in line {first[k].line} are both nearest to "
                f"line {right[k].line} of {right[k].file}",
            )
    return found
