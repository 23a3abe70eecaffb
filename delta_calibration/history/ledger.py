"""What is done of a fleet, beside the sessions in their store: failures, and changes by machine.

A result is written once: its key is the machine and the hash of the session. It is written by one
process, each in one transaction, so that a run that is stopped goes on where it was.
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
from delta_calibration.history.store import MACHINES, SESSIONS, Entry, Store, insert_entry

_NAME = 255
_METADATA = MetaData()
_FAILURES = Table(
    "fleet_failures",
    _METADATA,
    Column("machine", String(_NAME), primary_key=True),
    Column("id", String(_NAME), primary_key=True),
    Column("sha256", String(64), nullable=False),  # empty where it could not even be read
    Column("told", String, nullable=False),
    Column("tried", String(40), nullable=False),  # ISO 8601, UTC
)
_CHANGES = Table(
    "fleet_changes",
    _METADATA,
    Column("machine", String(_NAME), primary_key=True),
    Column("sessions_sha256", String(64), nullable=False),  # of the sessions that were compared
    Column("changes", JSON, nullable=False),
    Column("told", String, nullable=False),  # why there are none, where it failed
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
    """What changed of a machine, by all its sessions up to then."""

    machine: str
    sessions_sha256: str
    changes: tuple[dict[str, Any], ...]
    told: str = ""  # why it could not be found out


class Ledger:
    """A store of a history, with what is known to be done of a fleet."""

    def __init__(self, store: Store) -> None:
        """Take a store; the ledger's own tables are made where they are not there yet."""
        self.store = store
        with store.transaction() as connection:
            _METADATA.create_all(connection)
            _ONCE.create(connection, checkfirst=True)

    def done(self, machine: str, quick: bool) -> frozenset[str]:
        """Hashes of a machine's sessions that need no more work.

        Args:
            machine: its name.
            quick: whether a fit is all that is asked; else a verdict is, but of updates, of which
                none can be made.
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
        """Whether another session of the machine has that id."""
        here = (SESSIONS.c.machine == entry.machine) & (SESSIONS.c.id == entry.id)
        with self.store.transaction() as connection:
            known = connection.execute(select(SESSIONS.c.sha256).where(here)).scalar()
        return known not in (None, entry.sha256)

    def made_for(self) -> dict[str, tuple[str, str]]:
        """Robot and its hash of every machine that has sessions."""
        query = select(MACHINES.c.name, MACHINES.c.robot, MACHINES.c.robot_sha256)
        with self.store.transaction() as connection:
            return {r.name: (r.robot, r.robot_sha256) for r in connection.execute(query)}

    def failures(self) -> tuple[Failure, ...]:
        """All sessions without a result."""
        with self.store.transaction() as connection:
            rows = connection.execute(select(_FAILURES).order_by(_FAILURES.c.machine))
            return tuple(Failure(r.machine, r.id, r.sha256, r.told) for r in rows)

    def keep(self, entry: Entry, robot: str, robot_sha256: str) -> bool:
        """Write the result of a session, unless it is there; whether it was written."""
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
        """Write that a session gave no result."""
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
        """Write what changed of a machine, in the place of what was known before."""
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


def hash_of_sessions(hashes: Iterable[str]) -> str:
    """What stands for a set of sessions."""
    return hashlib.sha256("\n".join(sorted(hashes)).encode()).hexdigest()


def _forget_failure(connection: Connection, machine: str, name: str) -> None:
    here = (_FAILURES.c.machine == machine) & (_FAILURES.c.id == name)
    connection.execute(delete(_FAILURES).where(here))
