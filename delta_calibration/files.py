"""Reads and writes whole files of a user: only regular files, up to a largest size.

A pipe or a device may never end, and opening one may wait for ever; a file that unpacks to a
thousand times its size fills memory. Both are refused before anything is read from them.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from typing import BinaryIO

from delta_calibration.errors import InputError

_LONGEST = 200  # characters of a name that its temporary file repeats
MEGABYTE = 1 << 20
MOST_TEXT = 256 * MEGABYTE  # largest table: a million lines take 100 megabytes


def read_bounded(path: Path, most: int = MOST_TEXT, kind: type[InputError] = InputError) -> bytes:
    """Read a regular file of at most `most` bytes.

    Raises:
        InputError: (or the `kind` of it) no such file, no regular one, or a larger one.
    """
    try:
        with opened(path, most, kind) as file:
            return file.read(most)
    except OSError as error:
        raise kind(f"{path}: cannot be read: {error.strerror or error}") from error


@contextmanager
def opened(
    path: Path, most: int = MOST_TEXT, kind: type[InputError] = InputError
) -> Iterator[BinaryIO]:
    """Open a regular file of at most `most` bytes for reading.

    Raises:
        InputError: (or the `kind` of it) no regular file, or a larger one.
        OSError: no such file, or one that must not be read.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        require_regular(path, os.fstat(descriptor), most, kind)
        yield file


@contextmanager
def written_whole(
    path: Path, kind: type[InputError] = InputError, lasting: bool = False
) -> Iterator[Path]:
    """Write a file atomically: yield a temporary file, which then replaces the wanted one.

    If writing fails, the temporary file is removed and the wanted one is left as it was. Of a
    link, the file at its end is written. Two processes that write the same file do not disturb
    each other: the last to finish is right.

    Args:
        path: the wanted file.
        kind: class of the error.
        lasting: whether to flush the content to the disk before the rename, in case power fails.

    Raises:
        InputError: (or the `kind` of it) the file cannot be written.
    """
    try:
        place = Path(os.path.realpath(path)) if path.is_symlink() else path
        if path.exists() and not path.is_file():
            what = "a folder" if path.is_dir() else "a pipe, a device or a socket"
            raise kind(f"{path}: cannot be written: is {what}")
    except OSError as error:
        raise kind(f"{path}: cannot be written: {error.strerror or error}") from error
    # a name that nothing else has: not even a link can wait there
    beside = place.with_name(f".{place.name[:_LONGEST]}.{token_hex(4)}.part")
    try:
        yield beside
        if lasting:
            with beside.open("rb") as file:
                os.fsync(file.fileno())
        beside.replace(place)
    except OSError as error:
        raise kind(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # does not exist any more after success
            beside.unlink()


def require_regular(
    path: Path, found: os.stat_result, most: int, kind: type[InputError] = InputError
) -> None:
    """Refuse anything but a regular file of at most `most` bytes.

    Raises:
        InputError: (or the `kind` of it) names the file, what it is, and what is allowed.
    """
    if not stat.S_ISREG(found.st_mode):
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe, a device or a socket"
        raise kind(f"{path}: is {what}; a regular file is expected")
    if found.st_size > most:
        raise kind(f"{path}: {found.st_size} bytes; no file of this kind has more than {most}")
