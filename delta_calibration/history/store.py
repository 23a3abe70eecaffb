"""The store of a history: machines and their sessions, with the calibration and verdict of each.

A session is stored as the path of its folder, or its URL on any file system that fsspec supports
(`bags.py`), and the SHA-256 of its content. Calibration and verdict are stored as the JSON text of
their files. A store has a version: an older one is upgraded by `UPGRADES`, step by step in one
transaction, and a newer one is refused.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from sqlalchemy import (
    JSON,
    Column,
    Connection,
    Engine,
    ForeignKey,
    Integer,
    MetaData,
    String,
    Table,
    create_engine,
    event,
    insert,
    inspect,
    select,
    text,
    update,
)
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, SQLAlchemyError

from delta_calibration.errors import InputError
from delta_calibration.estimation import PRIOR_HISTORY
from delta_calibration.history.bags import bag_hash, is_there
from delta_calibration.wording import spoken

VERSION = 2
BY_COMMAND, BY_NODE = "delta-cal history add", "calibration_node"  # programs that add sessions
UPDATED = "update: fitted with the results of the history"
_NAME = 255
_POSTGRESQL = ("postgresql", "postgres")

_METADATA = MetaData()
_VERSION = Table("delta_cal_history", _METADATA, Column("version", Integer, nullable=False))
MACHINES = Table(
    "machines",
    _METADATA,
    Column("name", String(_NAME), primary_key=True),
    Column("robot", String, nullable=False),  # file or name, as given by the user
    Column("robot_sha256", String(64), nullable=False),
)
SESSIONS = Table(
    "sessions",
    _METADATA,
    Column("machine", ForeignKey("machines.name"), primary_key=True),
    Column("id", String(_NAME), primary_key=True),
    Column("path", String, nullable=False),
    Column("sha256", String(64), nullable=False),
    Column("began", String(40), nullable=False),  # ISO 8601, UTC
    Column("added", String(40), nullable=False),
    Column("topics", JSON, nullable=False),  # topics with non-standard names, as STREAM=TOPIC
    Column("calibration", JSON, nullable=False),
    Column("verdict", JSON, nullable=True),
    Column("added_by", String(_NAME), nullable=False, server_default=BY_COMMAND),
)


def _who_added(connection: Connection) -> None:
    """Upgrade to version 2: a column for the program that added a session."""
    connection.execute(
        text(
            f"ALTER TABLE sessions ADD COLUMN added_by VARCHAR({_NAME}) NOT NULL "
            f"DEFAULT '{BY_COMMAND}'"
        )
    )


# function that upgrades a store from this version to the next
UPGRADES: Mapping[int, Callable[[Connection], None]] = {1: _who_added}


@dataclass(frozen=True)
class Entry:
    """A session in the history of a machine."""

    machine: str
    id: str
    path: str  # path or URL of its folder
    sha256: str
    began: datetime
    added: datetime
    topics: tuple[str, ...]
    calibration: dict[str, Any]
    verdict: dict[str, Any] | None
    added_by: str = BY_COMMAND

    @property
    def is_update(self) -> bool:
        """Whether it was fitted with earlier sessions as prior."""
        return bool(self.calibration["provenance"].get("prior") == PRIOR_HISTORY)

    @property
    def found(self) -> str:
        """The causes that its verdict names, as the end of a sentence."""
        return self.named if self.verdict is None else f"found: {self.named}"

    @property
    def named(self) -> str:
        """The causes that its verdict names, in words."""
        if self.verdict is None:
            return UPDATED if self.is_update else "no causes looked for"
        named = [
            spoken(f["cause"]) + (f" at {f['location']}" if f["location"] else "")
            for f in self.verdict["findings"]
        ]
        return ", ".join(named) or "nothing beyond geometry"

    @property
    def error_left_mm(self) -> float:
        """Error left of its fit: RMS error at places that the fit has not seen [mm].

        Every session has it, with or without a diagnosis. It differs from the held-out error of a
        verdict, which holds out whole sectors.
        """
        return float(self.calibration["residuals"]["full"]["error_left_rms_mm"])

    def require_unchanged(self) -> None:
        """Refuse a session whose bag was moved or changed.

        Raises:
            InputError: says which of the two, and how to repair it.
        """
        if not is_there(self.path):
            raise InputError(
                f"session {self.id!r} of machine {self.machine!r} is no longer at {self.path}; "
                "add it again from its present place (`delta-cal history add`)"
            )
        if bag_hash(self.path) != self.sha256:
            raise InputError(
                f"session {self.id!r} of machine {self.machine!r}: {self.path} was changed since "
                "it was added; put the original back, or add it under another --id"
            )


class Store:
    """A database of machines and sessions."""

    def __init__(self, engine: Engine, name: str) -> None:
        """Use a database of the present version; see `open_store`."""
        self._engine, self._name = engine, name

    @property
    def name(self) -> str:
        """Name of the store: its file, or its URL without a password."""
        return self._name

    @contextmanager
    def transaction(self) -> Iterator[Connection]:
        """Write everything within the context or nothing; turns database errors into `InputError`.

        Raises:
            InputError: the database reports an error.
        """
        with _told(self._name), self._engine.begin() as connection:
            yield connection

    def robot_of(self, machine: str) -> tuple[str, str]:
        """Robot file or name of a machine, and its hash.

        Raises:
            InputError: no such machine.
        """
        query = select(MACHINES).where(MACHINES.c.name == machine)
        with _told(self._name), self._engine.connect() as connection:
            row = connection.execute(query).first()
        if row is None:
            known = ", ".join(name for name, _ in self.machines()) or "none"
            raise InputError(f"{self._name}: no machine {machine!r}; there are: {known}")
        return row.robot, row.robot_sha256

    def machines(self) -> tuple[tuple[str, str], ...]:
        """Name and robot of every machine."""
        with _told(self._name), self._engine.connect() as connection:
            rows = connection.execute(select(MACHINES).order_by(MACHINES.c.name))
            return tuple((row.name, row.robot) for row in rows)

    def sessions(self, machine: str) -> tuple[Entry, ...]:
        """Sessions of a machine, the earliest first.

        Raises:
            InputError: no such machine.
        """
        self.robot_of(machine)
        query = select(SESSIONS).where(SESSIONS.c.machine == machine)
        with _told(self._name), self._engine.connect() as connection:
            rows = connection.execute(query.order_by(SESSIONS.c.began, SESSIONS.c.id))
            return tuple(_entry(row._asdict()) for row in rows)

    def require_robot(self, machine: str, robot: str) -> None:
        """Refuse a robot file that is not that of the machine.

        Args:
            machine: name of the machine.
            robot: hash of the robot's file.

        Raises:
            InputError: no such machine, or the machine is of another robot.
        """
        known, made_for = self.robot_of(machine)
        if made_for != robot:
            raise InputError(
                f"{self._name}: machine {machine!r} is of robot {known!r} with hash "
                f"{made_for[:12]}; the file given has hash {robot[:12]}: another robot, or its "
                "file was changed; use that file, or another --machine"
            )

    def require_new(self, machine: str, robot: str, sha256: str, path: str, name: str) -> bool:
        """Refuse a session that cannot be added; returns whether it is a known one that was moved.

        Args:
            machine: name of the machine.
            robot: hash of the robot's file.
            sha256: hash of the session.
            path: path or URL of the session.
            name: id of the session.

        Raises:
            InputError: no name that can be read, another robot's file, the same session twice, or
                an id that is taken.
        """
        if machine != machine.strip() or not machine or not machine.isprintable():
            raise InputError(
                f"machine {machine!r}: a name is expected, without blanks around it, such as "
                "'press_3'"
            )
        if machine not in dict(self.machines()):
            return False
        self.require_robot(machine, robot)
        for entry in self.sessions(machine):
            if entry.sha256 == sha256:
                if is_there(entry.path):
                    raise InputError(
                        f"{path}: is in the history of {machine!r} already, as session "
                        f"{entry.id!r}, added on {entry.added:%Y-%m-%d}"
                    )
                return True
            if entry.id == name:
                raise InputError(
                    f"{path}: the history of {machine!r} has another session {name!r}; "
                    "give this one another name with --id"
                )
        return False

    def moved(self, machine: str, sha256: str, path: str) -> None:
        """Store the new path of a session that was moved."""
        here = (SESSIONS.c.machine == machine) & (SESSIONS.c.sha256 == sha256)
        with _told(self._name), self._engine.begin() as connection:
            connection.execute(update(SESSIONS).where(here).values(path=path))

    def add(self, entry: Entry, robot: str, robot_sha256: str) -> None:
        """Add a session, and its machine if it is the machine's first session."""
        with self.transaction() as connection:
            insert_entry(connection, entry, robot, robot_sha256)


def insert_entry(connection: Connection, entry: Entry, robot: str, robot_sha256: str) -> None:
    """Add a session within a transaction, and its machine if it is the machine's first session."""
    known = select(MACHINES.c.name).where(MACHINES.c.name == entry.machine)
    if connection.execute(known).first() is None:
        machine = {"name": entry.machine, "robot": robot, "robot_sha256": robot_sha256}
        connection.execute(insert(MACHINES).values(machine))
    connection.execute(
        insert(SESSIONS).values(
            machine=entry.machine,
            id=entry.id,
            path=entry.path,
            sha256=entry.sha256,
            began=entry.began.isoformat(),
            added=entry.added.isoformat(),
            topics=list(entry.topics),
            calibration=entry.calibration,
            verdict=entry.verdict,
            added_by=entry.added_by,
        )
    )


@contextmanager
def open_store(url: str, make: bool = False) -> Iterator[Store]:
    """Open a store: the file of an SQLite database, or a URL as SQLAlchemy takes it.

    Args:
        url: file or URL of the store.
        make: whether to create the store if it is missing; otherwise that is an error.

    Raises:
        InputError: it cannot be opened, is not a history, or has a newer version.
    """
    file = None if "://" in url else Path(url)
    if file is not None and not make and not file.is_file():
        raise InputError(f"{url}: no history found; `delta-cal history add` creates one")
    if file is not None and not file.absolute().parent.is_dir():
        raise InputError(f"{url}: the folder {file.parent} does not exist")
    engine, url = _engine(url, file)
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _foreign_keys)
    try:
        with _told(url), engine.begin() as connection:
            _bring_up(connection, url, make)
        yield Store(engine, url)
    finally:
        engine.dispose()


def _engine(url: str, file: Path | None) -> tuple[Engine, str]:
    """Create the database engine; also returns its URL without the password."""
    try:
        if file is not None:
            return create_engine(f"sqlite:///{file}"), url
        given = make_url(url)
        if given.drivername in _POSTGRESQL:
            given = given.set(drivername="postgresql+psycopg")
        return create_engine(given), make_url(url).render_as_string(hide_password=True)
    except ArgumentError as error:
        raise InputError(f"--store: cannot be opened: {_line(error)}") from error
    except ImportError as error:
        raise InputError(
            f"--store: its database needs {error.name or error}: "
            "pip install 'delta_calibration[history]'"
        ) from error


def _foreign_keys(connection: Any, _: Any) -> None:
    connection.execute("PRAGMA foreign_keys = ON")


def _bring_up(connection: Connection, url: str, make: bool) -> None:
    """Create the tables in an empty database, or upgrade an older store."""
    tables = inspect(connection).get_table_names()
    if _VERSION.name not in tables:
        if tables or not make:
            raise InputError(f"{url}: a database, but no history of delta-cal")
        _METADATA.create_all(connection)
        connection.execute(insert(_VERSION).values(version=VERSION))
        return
    version = connection.execute(select(_VERSION.c.version)).scalar_one()
    if version > VERSION:
        raise InputError(
            f"{url}: a history of version {version}, but this program supports {VERSION}: it was "
            "written by a newer delta-cal; use that one"
        )
    for step in range(version, VERSION):
        UPGRADES[step](connection)
        connection.execute(update(_VERSION).values(version=step + 1))


def _entry(row: Mapping[str, Any]) -> Entry:
    return Entry(
        machine=row["machine"],
        id=row["id"],
        path=row["path"],
        sha256=row["sha256"],
        began=datetime.fromisoformat(row["began"]),
        added=datetime.fromisoformat(row["added"]),
        topics=tuple(row["topics"]),
        calibration=row["calibration"],
        verdict=row["verdict"],
        added_by=row["added_by"],
    )


@contextmanager
def _told(url: str) -> Iterator[None]:
    """Turn errors of the database into `InputError`."""
    try:
        yield
    except (SQLAlchemyError, json.JSONDecodeError) as error:
        raise InputError(f"{url}: {_line(error)}") from error


def _line(error: Exception) -> str:
    return str(getattr(error, "orig", None) or error).splitlines()[0][:200]
