"""Access to bags: local folders, or URLs on any file system that fsspec supports.

URLs have the form that fsspec takes: `s3://bucket/day_1`, `zip://day_1::/archive/days.zip`. A bag
at a URL is copied to a temporary folder for reading. Only URLs need fsspec
(`pip install 'delta_calibration[history]'`); some protocols need another package, which fsspec's
error message names.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from delta_calibration.errors import InputError

_CHUNK = 1 << 20


def is_url(path: str) -> bool:
    """Whether a path is a URL, to be opened by fsspec."""
    return "://" in path


def place_of(path: str) -> str:
    """Path that is valid from any working directory: URLs unchanged, folders made absolute."""
    return path if is_url(path) else str(Path(path).resolve())


def name_of(path: str) -> str:
    """Name of the folder that a path or URL leads to."""
    return PurePosixPath(path.split("::")[0]).name if is_url(path) else Path(path).resolve().name


def is_there(path: str) -> bool:
    """Whether a folder exists.

    Raises:
        InputError: its file system cannot be reached.
    """
    if not is_url(path):
        return Path(path).is_dir()
    with _told(path):
        system, root = _system(path)
        return bool(system.isdir(root))


def bag_hash(path: str) -> str:
    """SHA-256 of the names and contents of all files in a folder.

    Raises:
        InputError: a file cannot be read.
    """
    whole = hashlib.sha256()
    with _told(path):
        for name, opened in sorted(_files(path), key=lambda each: PurePosixPath(each[0])):
            own = hashlib.sha256()
            with opened() as file:
                while chunk := file.read(_CHUNK):
                    own.update(chunk)
            whole.update(f"{name}\n{own.hexdigest()}\n".encode())
    return whole.hexdigest()


@contextmanager
def at_hand(path: str) -> Iterator[Path]:
    """Yield a local folder: the folder itself, or a copy that is deleted when the context ends.

    Raises:
        InputError: a file cannot be read.
    """
    if not is_url(path):
        yield Path(path)
        return
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / name_of(path)
        with _told(path):
            for name, opened in _files(path):
                goal = own / name
                goal.parent.mkdir(parents=True, exist_ok=True)
                with opened() as file, goal.open("wb") as out:
                    while chunk := file.read(_CHUNK):
                        out.write(chunk)
        yield own


def _files(path: str) -> list[tuple[str, Callable[[], BinaryIO]]]:
    """List all files of a folder: name relative to the folder, and a function that opens it."""
    if not is_url(path):
        root = Path(path)
        return [
            (file.relative_to(root).as_posix(), _local(file))
            for file in root.rglob("*")
            if file.is_file()
        ]
    system, top = _system(path)
    found = []
    for file in system.find(top):
        name = PurePosixPath("/" + file.strip("/")).relative_to("/" + top.strip("/"))
        if ".." in name.parts:
            raise InputError(f"{path}: contains a file {file!r} that lies outside it")
        found.append((str(name), _remote(system, file)))
    return found


def _local(file: Path) -> Callable[[], BinaryIO]:
    return lambda: file.open("rb")


def _remote(system: Any, file: str) -> Callable[[], BinaryIO]:
    return lambda: system.open(file, "rb")


def _system(path: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs
    except ModuleNotFoundError as error:
        raise InputError(
            f"{path}: a URL needs fsspec: pip install 'delta_calibration[history]'"
        ) from error
    system, root = url_to_fs(path)
    return system, str(root)


@contextmanager
def _told(path: str) -> Iterator[None]:
    """Turn errors of a file system into `InputError`."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, ImportError) as error:  # the protocol is unknown or not installed
        raise InputError(f"{path}: cannot be read: {error}") from error
