"""Files of a user, read and written whole: regular files only, no larger than they may be.

A pipe or a device may never end, and opening one may wait for ever; a file that unpacks to a
thousand times its size fills memory. Both are refused before anything of them is read.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from delta_calibration.errors import InputError

MEGABYTE = 1 << 20
MOST_TEXT = 256 * MEGABYTE  # of a table: a million lines have 100


def read_bounded(path: Path, most: int = MOST_TEXT, kind: type[InputError] = InputError) -> bytes:
    """The content of a regular file of at most so many bytes.

    Raises:
        InputError: (or the `kind` of it) no such file, no regular one, or a larger one.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            require_regular(path, os.fstat(descriptor), most, kind)
            return file.read(most)
    except OSError as error:
        raise kind(f"{path}: cannot be read: {error.strerror or error}") from error


@contextmanager
def written_whole(
    path: Path, kind: type[InputError] = InputError, lasting: bool = False
) -> Iterator[Path]:
    """A file beside the wanted one, to be written; takes its place if that went well, else goes.

    Args:
        path: the wanted file.
        kind: of the error.
        lasting: whether its content must be on the disk before its name, should the power fail.

    Raises:
        InputError: (or the `kind` of it) the file cannot be written.
    """
    beside = path.with_name(f".{path.name}.part")
    with suppress(OSError):  # of a write that was cut off; a link or a pipe is not written to
        beside.unlink()
    try:
        yield beside
        if lasting:
            with beside.open("rb") as file:
                os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        raise kind(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # gone where all went well
            beside.unlink()


def require_regular(
    path: Path, found: os.stat_result, most: int, kind: type[InputError] = InputError
) -> None:
    """Refuse what is no regular file, or a larger one.

    Raises:
        InputError: (or the `kind` of it) names the file, what it is, and what is allowed.
    """
    if not stat.S_ISREG(found.st_mode):
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe, a device or a socket"
        raise kind(f"{path}: is {what}; a regular file is expected")
    if found.st_size > most:
        raise kind(f"{path}: {found.st_size} bytes; no file of this kind has more than {most}")
