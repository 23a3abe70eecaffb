"""Progress of a fleet run, kept in the store: results, failures, and changes by machine.

Each session has one result; its key is the machine and the hash of the session. One process writes
all results, each in one transaction, so that an interrupted run can be resumed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from sqlalchemy import (
    JSON,
    Column,
    Connection,
    Index,
    MetaData,
    String,
    Table,
    cast,
    delete,
    insert,
    or_,
    select,
    update,
)

from delta_calibration.estimation import PRIOR_HISTORY
from delta_calibration.history.changes import Change
from delta_calibration.history.store import MACHINES, SESSIONS, Entry, Store, insert_entry

_NAME = 255
_METADATA = MetaData()
_FAILURES = Table(
    "fleet_failures",
    _METADATA,
    Column("machine", String(_NAME), primary_key=True),
    Column("id", String(_NAME), primary_key=True),
    Column("sha256", String(64), nullable=False),  # empty if it could not even be read
    Column("told", String, nullable=False),
    Column("tried", String(40), nullable=False),  # ISO 8601, UTC
)
_CHANGES = Table(
    "fleet_changes",
    _METADATA,
    Column("machine", String(_NAME), primary_key=True),
    Column("sessions_sha256", String(64), nullable=False),  # of the sessions that were compared
    Column("changes", JSON, nullable=False),
    Column("told", String, nullable=False),  # error message if the comparison failed
)
_ONCE = Index("one_result", SESSIONS.c.machine, SESSIONS.c.sha256, unique=True)


@dataclass(frozen=True)
class Failure:
    """A session that gave no result, and why."""

    machine: str
    id: str
    sha256: str
    told: str


@dataclass(frozen=True)
class Compared:
    """Changes of a machine, from a comparison of all its sessions so far."""

    machine: str
    sessions_sha256: str
    changes: tuple[dict[str, Any], ...]
    told: str = ""  # error message if the comparison failed


class Ledger:
    """A store of a history, with the progress of fleet runs in additional tables."""

    def __init__(self, store: Store) -> None:
        """Use a store; the ledger's own tables are created if they are missing."""
        self.store = store
        with store.transaction() as connection:
            _METADATA.create_all(connection)
            _ONCE.create(connection, checkfirst=True)

    def done(self, machine: str, quick: bool) -> frozenset[str]:
        """Hashes of a machine's sessions that need no more work.

        Args:
            machine: name of the machine.
            quick: whether a fit is enough; otherwise a session needs a verdict, except updates,
                which cannot have one.
        """
        here = SESSIONS.c.machine == machine
        query = select(SESSIONS.c.sha256).where(here)
        # a JSON column holds the JSON value null where there is no verdict; not all databases
        # compare JSON
        judged = cast(SESSIONS.c.verdict, String) != "null"
        told = SESSIONS.c.calibration["provenance"]["prior"].as_string() == PRIOR_HISTORY
        query = query if quick else query.where(or_(judged, told))
        with self.store.transaction() as connection:
            return frozenset(connection.execute(query).scalars())

    def taken(self, entry: Entry) -> bool:
        """Whether another session of the machine already has the entry's id."""
        here = (SESSIONS.c.machine == entry.machine) & (SESSIONS.c.id == entry.id)
        with self.store.transaction() as connection:
            known = connection.execute(select(SESSIONS.c.sha256).where(here)).scalar()
        return known not in (None, entry.sha256)

    def made_for(self) -> dict[str, tuple[str, str]]:
        """Robot and robot hash of every machine that has sessions, by machine name."""
        query = select(MACHINES.c.name, MACHINES.c.robot, MACHINES.c.robot_sha256)
        with self.store.transaction() as connection:
            return {r.name: (r.robot, r.robot_sha256) for r in connection.execute(query)}

    def failures(self) -> tuple[Failure, ...]:
        """All failed sessions, by machine."""
        with self.store.transaction() as connection:
            rows = connection.execute(select(_FAILURES).order_by(_FAILURES.c.machine))
            return tuple(Failure(r.machine, r.id, r.sha256, r.told) for r in rows)

    def keep(self, entry: Entry, robot: str, robot_sha256: str) -> bool:
        """Write a new result, or add a verdict to a fit; returns whether something was written."""
        here = (SESSIONS.c.machine == entry.machine) & (SESSIONS.c.sha256 == entry.sha256)
        with self.store.transaction() as connection:
            _forget_failure(connection, entry.machine, entry.id)
            known = connection.execute(select(SESSIONS.c.verdict).where(here)).first()
            if known is None:
                insert_entry(connection, entry, robot, robot_sha256)
                return True
            if known.verdict is not None or entry.verdict is None:
                return False
            new = {"calibration": entry.calibration, "verdict": entry.verdict}
            connection.execute(update(SESSIONS).where(here).values(new))
            return True

    def fail(self, failure: Failure) -> None:
        """Record that a session gave no result, and why."""
        with self.store.transaction() as connection:
            _forget_failure(connection, failure.machine, failure.id)
            connection.execute(
                insert(_FAILURES).values(
                    machine=failure.machine,
                    id=failure.id,
                    sha256=failure.sha256,
                    told=failure.told,
                    tried=datetime.now(timezone.utc).isoformat(),
                )
            )

    def compared(self, machine: str | None = None) -> dict[str, Compared]:
        """The last comparison of the sessions of each machine, or of one."""
        query = select(_CHANGES)
        if machine is not None:
            query = query.where(_CHANGES.c.machine == machine)
        with self.store.transaction() as connection:
            rows = connection.execute(query)
            found = (
                Compared(r.machine, r.sessions_sha256, tuple(r.changes), r.told) for r in rows
            )
            return {each.machine: each for each in found}

    def keep_compared(self, found: Compared) -> None:
        """Write the comparison of a machine's sessions, replacing the last one."""
        with self.store.transaction() as connection:
            connection.execute(delete(_CHANGES).where(_CHANGES.c.machine == found.machine))
            connection.execute(
                insert(_CHANGES).values(
                    machine=found.machine,
                    sessions_sha256=found.sessions_sha256,
                    changes=list(found.changes),
                    told=found.told,
                )
            )


def compared_of(machine: str, entries: Iterable[Entry], changes: Iterable[Change]) -> Compared:
    """The changes that were found between all these sessions of a machine, to be kept."""
    told = ({**c.as_dict(), "signal": c.signal, "told": c.sentence()} for c in changes)
    return Compared(machine, hash_of_sessions(entry.sha256 for entry in entries), tuple(told))


def hash_of_sessions(hashes: Iterable[str]) -> str:
    """Hash of a set of sessions, independent of their order."""
    return hashlib.sha256("\n".join(sorted(hashes)).encode()).hexdigest()


def _forget_failure(connection: Connection, machine: str, name: str) -> None:
    here = (_FAILURES.c.machine == machine) & (_FAILURES.c.id == name)
    connection.execute(delete(_FAILURES).where(here))
