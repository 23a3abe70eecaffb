"""Store uploaded files in the folder of a case, limited in size and never outside the folder.

The limits of a zip apply to the bytes that are actually unpacked, not to the sizes in its
directory: at most `MOST_FILES` files and the allowed bytes, and beyond `ALWAYS` at most
`MOST_RATIO` times its own size. Only the regular files of one recording are unpacked. A file name
that leads elsewhere is refused, and names of sessions are reduced to safe characters.
"""

from __future__ import annotations

import stat
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from delta_calibration.bench.cases import BAG, TABLE, file_name
from delta_calibration.errors import InputError
from delta_calibration.files import MEGABYTE, MOST_TEXT

METADATA = "metadata.yaml"
RECORDED = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
TABLES = (".csv", ".txt", ".tsv", ".asc", ".dat", ".log", ".mod", ".ls", ".xlsx")
KINDS = "a zip of a session's folder, a .mcap or .db3 file, or a table (csv, txt, xlsx ...)"
MOST_FILES = 200  # most files in a zip
MOST_RATIO = 200  # largest ratio of unpacked to packed size, beyond ALWAYS
ALWAYS = 64 * MEGABYTE  # unpacked size that is allowed for any zip
MOST_SMALL = 2 * MEGABYTE  # most bytes of a robot file or a list of points
_CHUNK = MEGABYTE


@dataclass(frozen=True)
class Dropped:
    """A session or table that was stored in a case's folder.

    Attributes:
        kind: `bag` or `table`.
        name: name of the session.
        path: path of the session's folder or of the table, relative to the case's folder.
    """

    kind: str
    name: str
    path: str


def take_all(files: Sequence[tuple[IO[bytes], str]], folder: Path, most: int) -> Dropped:
    """Store files that were dropped together: a single file, or those of a session's folder.

    Args:
        files: content and name of each file, as sent by the browser.
        folder: folder of the case.
        most: most bytes of all files, unpacked.

    Raises:
        InputError: names the file, what is wrong with it, and what is allowed.
    """
    if not files:
        raise InputError(f"no file was chosen; {KINDS} is expected")
    if len(files) == 1:
        return take(*files[0], folder, most)
    data = sorted(name for _, name in files if name != METADATA)
    others = [name for name in data if not name.lower().endswith(RECORDED)]
    if others or not data:
        raise InputError(
            f"{_called((*others, METADATA)[0])}: several files at once must be the files of one "
            f"session: {METADATA} and .mcap or .db3 files"
        )
    session = file_name(data[0], "session").split(".")[0]
    home, left = _made(folder / "bag" / session), most
    for stream, name in files:
        path = home / file_name(name, "data.mcap")
        if path.exists():
            raise InputError(f"{_called(name)}: is given twice")
        left -= copy(stream, name, path, left)
    return Dropped(BAG, session, f"bag/{session}")


def take(stream: IO[bytes], given: str, folder: Path, most: int) -> Dropped:
    """Store a session or a table in a case's folder.

    Args:
        stream: content of the file, from its beginning.
        given: name of the file, as sent by the browser.
        folder: folder of the case.
        most: most bytes of the file, unpacked.

    Raises:
        InputError: names the file, what is wrong with it, and what is allowed.
    """
    lower = given.lower()
    if lower.endswith(".zip"):
        return _take_zip(stream, given, folder, most)
    if lower.endswith(RECORDED):
        name = file_name(given, "session.mcap")
        session = name.split(".")[0] or "session"
        copy(stream, given, _made(folder / "bag" / session) / name, most)
        return Dropped(BAG, session, f"bag/{session}")
    if lower.endswith(TABLES):
        name = file_name(given, "table.csv")
        copy(stream, given, _made(folder / "table") / name, min(most, MOST_TEXT))
        return Dropped(TABLE, Path(name).stem, f"table/{name}")
    raise InputError(f"{_called(given)}: is not a file that can be used here: {KINDS}")


def copy(stream: IO[bytes], given: str, path: Path, most: int) -> int:
    """Write a stream to a new file and return the number of bytes.

    Raises:
        InputError: the stream is too long or empty, or the file cannot be written.
    """
    size = 0
    try:
        with path.open("xb") as file:
            while chunk := stream.read(_CHUNK):
                size += len(chunk)
                if size > most:
                    raise InputError(
                        f"{_called(given)}: is larger than the limit of {_told(most)}"
                    )
                file.write(chunk)
    except OSError as error:
        why = error.strerror or str(error)
        raise InputError(f"{_called(given)}: cannot be stored: {why}") from error
    if not size:
        raise InputError(f"{_called(given)}: is empty")
    return size


def _take_zip(stream: IO[bytes], given: str, folder: Path, most: int) -> Dropped:
    """Unpack the one recording in a zip."""
    packed = stream.seek(0, 2)
    stream.seek(0)
    try:
        with zipfile.ZipFile(stream) as archive:
            wanted = _recording(archive, given)
            inside = wanted[0].filename.split("/")
            session = file_name(inside[-2] if len(inside) > 1 else "", "") or file_name(
                Path(given).stem, "session"
            )
            most = min(most, max(ALWAYS, MOST_RATIO * packed))
            _unpack(archive, wanted, given, _made(folder / "bag" / session), most)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{_called(given)}: is not a readable zip file: {error}") from error
    return Dropped(BAG, session, f"bag/{session}")


def _recording(archive: zipfile.ZipFile, given: str) -> list[zipfile.ZipInfo]:
    """List the files of the one recording in a zip; other files are ignored.

    Raises:
        InputError: too many files, an entry that is refused, or not exactly one recording.
    """
    entries = [entry for entry in archive.infolist() if not entry.is_dir()]
    if len(entries) > MOST_FILES:
        raise InputError(
            f"{_called(given)}: holds {len(entries)} files; no more than {MOST_FILES} are allowed"
        )
    for entry in entries:
        _require_plain(entry, given)
    data = [e for e in entries if e.filename.lower().endswith(RECORDED) and not _hidden(e)]
    folders = {PurePosixPath(entry.filename).parent for entry in data}
    if len(folders) != 1:
        found = "no .mcap or .db3 file" if not folders else f"recordings in {len(folders)} folders"
        raise InputError(f"{_called(given)}: holds {found}; the zip of one session is expected")
    (home,) = folders
    beside = [entry for entry in entries if entry.filename == str(home / METADATA)]
    return [*data, *beside]


def _require_plain(entry: zipfile.ZipInfo, given: str) -> None:
    """Refuse an entry that is a link or device, is encrypted, or leads out of its folder.

    Raises:
        InputError: names the entry.
    """
    name = entry.filename
    parts = name.replace("\\", "/").split("/")
    kind = stat.S_IFMT(entry.external_attr >> 16)
    why = ""
    if name.startswith(("/", "\\")) or ".." in parts or ":" in parts[0] or "\\" in name:
        why = "lies outside the folder"
    elif kind not in (0, stat.S_IFREG):
        why = "is a link or a device, not a file"
    elif entry.flag_bits & 1:
        why = "is protected by a password"
    if why:
        raise InputError(f"{_called(given)}: {_called(name)} in it {why}")


def _hidden(entry: zipfile.ZipInfo) -> bool:
    """Whether an entry is hidden or written by macOS for itself (`__MACOSX/._data.mcap`)."""
    parts = entry.filename.split("/")
    return parts[0] == "__MACOSX" or parts[-1].startswith(".")


def _unpack(
    archive: zipfile.ZipFile, wanted: list[zipfile.ZipInfo], given: str, home: Path, most: int
) -> None:
    left = most
    for entry in wanted:
        name = PurePosixPath(entry.filename).name
        if name != METADATA and name != file_name(name, "", 200):
            raise InputError(
                f"{_called(given)}: {_called(name)} in it: letters, digits, . _ and - are allowed"
            )
        with archive.open(entry) as stream:
            path = home / name
            if path.exists():
                raise InputError(f"{_called(given)}: holds {_called(name)} twice")
            try:
                left -= copy(stream, name, path, left)
            except InputError as error:
                raise InputError(f"{_called(given)}, unpacked: {error}") from error


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True)
    return folder


def _told(size: int) -> str:
    return f"{size / MEGABYTE:.0f} MB" if size >= MEGABYTE else f"{size} bytes"


def _called(name: str) -> str:
    """Make a file name from outside fit for a message: printable and at most 80 characters."""
    plain = "".join(c if c.isprintable() else "?" for c in name)
    return plain if len(plain) <= 80 else f"{plain[:77]}..."
