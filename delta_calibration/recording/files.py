"""Which files make up a recording, and their content as raw topics."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from delta_calibration.errors import RecordingError
from delta_calibration.files import require_regular
from delta_calibration.recording.bag_metadata import FILE_NAME, read_metadata
from delta_calibration.recording.mcap_file import decompress, read_mcap
from delta_calibration.recording.raw import Keep, RawRecording, RawTopic
from delta_calibration.recording.sqlite_file import SQLITE_MAGIC, read_sqlite

_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_NAMED = 6  # recordings of a folder that a message lists at most
_MOST = 1 << 40  # bytes of a file at most
_ALWAYS = 64 << 20  # bytes to which any file or message may unpack, however small it is
_MOST_RATIO = 200  # a file may unpack to this many times its size; joint states reach 10 times
_MOST_UNPACKED = 2 << 30  # bytes: it is held in memory
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class SessionFiles:
    """The files of one recording, in the order they were written."""

    data: tuple[Path, ...]
    custom_data: Mapping[str, str]
    compression_mode: str
    notes: tuple[str, ...]


def locate(path: Path) -> SessionFiles:
    """Find the files of a recording.

    Args:
        path: Its folder, the `metadata.yaml` in it, or a bare data file.

    Raises:
        RecordingError: There is no such path, or no recording in it.
    """
    try:
        if not path.exists():
            raise RecordingError(f"{path} does not exist")
        if path.name == FILE_NAME:
            path = path.parent
        if path.is_dir():
            return _of_folder(path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    described = read_metadata(path.parent / FILE_NAME)
    if described is None or path.name not in described.files:
        return SessionFiles((path,), {}, "", ())
    return SessionFiles((path,), described.custom_data or {}, described.compression_mode, ())


def load_raw(path: Path, keep: Keep) -> tuple[RawRecording, SessionFiles]:
    """Read all files of a recording.

    Args:
        path: As for `locate`.
        keep: Which message types are to be kept; others are counted only.

    Raises:
        RecordingError: Not found, not readable, or not a recording.
    """
    files = locate(path)
    recording = RawRecording(keep)
    for file in files.data:
        try:
            _read_file(file, recording)
        except RecordingError as error:
            if len(files.data) == 1:
                raise
            # A crash right after a split leaves one bad file; the others are still read.
            recording.complete = False
            recording.notes.append(f"{error}: its data is lost")
    if files.compression_mode == "message":
        for topic in recording.topics.values():
            topic.records = _unpacked(topic)
    return recording, files


def open_data(path: Path) -> BinaryIO:
    """Open a data file; if it was compressed as a whole, it is unpacked in memory."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    stream = os.fdopen(descriptor, "rb")
    size = _size(path, stream)
    if stream.read(len(_ZSTD_MAGIC)) == _ZSTD_MAGIC:
        with stream:
            stream.seek(0)
            most = min(_MOST_UNPACKED, max(_ALWAYS, _MOST_RATIO * size))
            return BytesIO(decompress(stream.read(), "zstd", most))
    stream.seek(0)
    return stream


def _size(path: Path, stream: BinaryIO) -> int:
    """Size of a file in bytes; a file that is not regular is closed again and refused."""
    found = os.fstat(stream.fileno())
    try:
        require_regular(path, found, _MOST, RecordingError)
    except RecordingError as error:
        stream.close()
        raise RecordingError(str(error).removeprefix(f"{path}: ")) from error
    return found.st_size


def is_sqlite(stream: BinaryIO) -> bool:
    """Whether a data file is an SQLite file; rewinds it."""
    stream.seek(0)
    magic = stream.read(len(SQLITE_MAGIC))
    stream.seek(0)
    return magic == SQLITE_MAGIC


def _read_file(path: Path, recording: RawRecording) -> None:
    try:
        _read_by_kind(path, recording)
    except RecordingError as error:
        raise RecordingError(f"{path} {error}") from error
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    except (ValueError, sqlite3.Error) as error:
        raise RecordingError(f"{path} cannot be read: {error}") from error


def _read_by_kind(path: Path, recording: RawRecording) -> None:
    with open_data(path) as stream:
        if not is_sqlite(stream):
            return read_mcap(stream, path.name, recording)
        if isinstance(stream, BytesIO):
            raise RecordingError("is compressed SQLite: unpack it with zstd -d first")
    return read_sqlite(path, recording)


def _unpacked(topic: RawTopic) -> list[bytes]:
    try:
        return [decompress(record, "zstd", _ALWAYS) for record in topic.records]
    except ValueError as error:
        raise RecordingError(
            f"{topic.name}: {FILE_NAME} says that messages are compressed, but: {error}"
        ) from error


def _of_folder(folder: Path) -> SessionFiles:
    described = read_metadata(folder / FILE_NAME)
    there = sorted(
        (p for p in folder.iterdir() if p.is_file() and p.name.endswith(_SUFFIXES)), key=_natural
    )
    notes = []
    if described is None:
        listed: tuple[Path, ...] = ()
        notes.append(
            f"{folder / FILE_NAME} is missing or unreadable: the data files are read without it"
        )
    else:
        listed = tuple(folder / name for name in described.files)
        absent = [p.name for p in listed if not p.exists()]
        if absent:
            notes.append(
                f"{', '.join(absent)}: listed in {FILE_NAME} but missing, its data is lost"
            )
        extra = [p.name for p in there if p not in listed]
        if extra:
            notes.append(f"{', '.join(extra)}: not listed in {FILE_NAME}, but read as well")
    data = (*(p for p in listed if p.exists()), *(p for p in there if p not in listed))
    if not data:
        raise RecordingError(
            f"{folder} contains no recording (no .mcap or .db3 file){_sessions_in(folder)}"
        )
    custom = (described.custom_data or {}) if described else {}
    mode = described.compression_mode if described else ""
    return SessionFiles(data, custom, mode, tuple(notes))


def _sessions_in(folder: Path) -> str:
    """Hint that lists the recordings inside a folder, one of which may be meant."""
    there = sorted((p for p in folder.iterdir() if (p / FILE_NAME).is_file()), key=_natural)
    names = ", ".join(p.name for p in there[:_NAMED])
    more = f" and {len(there) - _NAMED} more" if len(there) > _NAMED else ""
    return f"; recordings in it: {names}{more}" if there else ""


def _natural(path: Path) -> tuple[object, ...]:
    """Natural sort key: bag_10 comes after bag_9."""
    return tuple(
        (1, int(part), "") if part.isdigit() else (0, 0, part)
        for part in re.split(r"(\d+)", path.name)
    )
