"""Sessions of a fleet in a folder of machines, on any file system that fsspec supports.

FLEET/robot.yaml                the robot of all machines without a robot file of their own
FLEET/MACHINE/robot.yaml        the robot of this machine
FLEET/MACHINE/SESSION/          a rosbag2 folder
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from delta_calibration.documents import Document, check_document, parse_yaml
from delta_calibration.errors import InputError
from delta_calibration.robot import robot_document

ROBOT = "robot.yaml"


@dataclass(frozen=True)
class RobotFile:
    """Content of a robot file, to be sent to workers that do not have the file."""

    given: str  # path, URL or name
    document: Document


@dataclass(frozen=True)
class Place:
    """A session of a machine and the place of its folder."""

    id: str
    url: str  # path or URL of its folder
    topics: tuple[str, ...] = ()


@dataclass(frozen=True)
class Machine:
    """A machine with its sessions."""

    name: str
    robot: RobotFile
    sessions: tuple[Place, ...]


def is_folder(source: str) -> bool:
    """Whether a source of sessions is a folder of machines; otherwise it is a history store.

    Raises:
        InputError: it is neither.
    """
    protocol, found, _ = source.partition("://")
    if found:
        return protocol in fsspec.available_protocols()
    path = Path(source)
    if not path.exists():
        raise InputError(f"{source}: neither a folder of machines nor a history")
    return path.is_dir()


def machines_in(
    source: str, robot: RobotFile | None, topics: tuple[str, ...] = ()
) -> tuple[Machine, ...]:
    """List the machines in a folder, by name.

    Args:
        source: path or URL of the folder.
        robot: robot of all machines; if None, each machine or the folder has a `robot.yaml`.
        topics: topics with non-standard names, the same in all sessions.

    Raises:
        InputError: the folder is missing or has no machines, or a machine has no robot.
    """
    system, root = _opened(source)
    shared = robot or _robot_in(system, root)
    found = []
    for folder in _folders(system, root):
        own = robot or _robot_in(system, folder) or shared
        name = folder.rsplit("/", 1)[-1]
        if own is None:
            raise InputError(
                f"{source}: machine {name!r} has no {ROBOT}, nor has the folder: give --robot"
            )
        sessions = tuple(
            Place(each.rsplit("/", 1)[-1], _url(system, each), topics)
            for each in _folders(system, folder)
        )
        if sessions:
            found.append(Machine(name, own, sessions))
    if not found:
        raise InputError(
            f"{source}: contains no machine; expected is one folder per machine with one folder "
            "per session"
        )
    return tuple(found)


def robot_file(given: str) -> RobotFile:
    """Read a robot file by its path, or by the name of one that comes with the package.

    Raises:
        ConfigError: there is no such file.
    """
    path, document = robot_document(given)
    kept = str(path.resolve()) if Path(given).is_file() else given
    return RobotFile(kept, document)


@contextmanager
def local(url: str) -> Iterator[Path]:
    """Yield a local folder of a session: the folder itself, or a copy that is deleted afterwards.

    Raises:
        InputError: it cannot be read.
    """
    system, path = _opened(url)
    if isinstance(system, LocalFileSystem):
        yield Path(path)
        return
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / path.rsplit("/", 1)[-1]
        try:
            system.get(path, str(own), recursive=True)
        except (OSError, ValueError) as error:
            raise InputError(f"{url}: cannot be read: {error}") from error
        yield own


def _opened(url: str) -> tuple[Any, str]:
    try:
        system, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError, OSError) as error:
        raise InputError(f"{url}: cannot be opened: {error}") from error
    return system, str(path).rstrip("/")


def _folders(system: Any, path: str) -> list[str]:
    """Sub-folders of a folder, sorted by name, without hidden ones."""
    try:
        inside = system.ls(path, detail=True)
    except (OSError, ValueError) as error:
        raise InputError(f"{system.unstrip_protocol(path)}: cannot be read: {error}") from error
    names = (str(e["name"]).rstrip("/") for e in inside if e["type"] == "directory")
    return sorted(name for name in names if not name.rsplit("/", 1)[-1].startswith("."))


def _robot_in(system: Any, folder: str) -> RobotFile | None:
    path = f"{folder}/{ROBOT}"
    if not system.isfile(path):
        return None
    url = _url(system, path)
    if isinstance(system, LocalFileSystem):
        return robot_file(url)
    document = parse_yaml(system.cat_file(path).decode(), url)
    check_document(document, {"type": "object"}, url)
    return RobotFile(url, document)


def _url(system: Any, path: str) -> str:
    """The path itself if it is local, otherwise its URL."""
    return path if isinstance(system, LocalFileSystem) else str(system.unstrip_protocol(path))
