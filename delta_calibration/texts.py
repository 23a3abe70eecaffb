"""Reads text files of a user (UTF-8) and plain decimal numbers; shortens texts for messages."""

from __future__ import annotations

import codecs
import re
from collections.abc import Sequence
from pathlib import Path

from delta_calibration.errors import InputError
from delta_calibration.files import MOST_TEXT, read_bounded

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_ARCHIVE = b"PK\x03\x04"  # workbooks (xlsx, ods) are archives


def read_text(path: Path, kind: type[InputError] = InputError, most: int = MOST_TEXT) -> str:
    """Read a text file, without the byte order mark that some programs put in front.

    Raises:
        InputError: (or the `kind` of it) no such file, no regular one, one of more than `most`
            bytes, or in another encoding than UTF-8; names the file, the encoding if it can be
            recognised, and the remedy.
    """
    data = read_bounded(path, most, kind)
    if data.startswith(_ARCHIVE):
        raise kind(f"{path}: is a workbook or another archive; export a text file (CSV, UTF-8)")
    if data.startswith(_UTF16):
        raise kind(f"{path}: is in UTF-16; save it as UTF-8")
    if 0 in data:
        line = data.count(b"\n", 0, data.index(0)) + 1
        raise kind(
            f"{path}: line {line}: a zero byte; the file is in UTF-16 or is not a text: save it "
            "as UTF-8"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise kind(
            f"{path}: line {line}: byte 0x{data[error.start]:02x} is not UTF-8; the file is in "
            "another encoding, such as Latin-1: save it as UTF-8"
        ) from error


def listed(names: Sequence[str], most: int = 12, longest: int = 40) -> str:
    """List foreign names in a message of bounded length: only the first few, each cut."""
    cut = (name if len(name) <= longest else f"{name[:longest]}..." for name in names[:most])
    shown = [repr(name) for name in cut]  # repr keeps the message on one line
    more = [f"and {len(names) - most} more"] if len(names) > most else []
    return f"[{', '.join([*shown, *more])}]"


def bounded(text: str, most: int = 1000) -> str:
    """A message that quotes foreign text, cut after `most` characters."""
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"


def number_of(text: str) -> float:
    """Convert a plain, finite decimal number; NaN for any other text.

    Python's `float` accepts more: `31_49.0`, digits of other scripts, `inf`.
    """
    text = text.strip()
    value = float(text) if _PLAIN.fullmatch(text) else float("nan")
    return value if abs(value) < float("inf") else float("nan")
