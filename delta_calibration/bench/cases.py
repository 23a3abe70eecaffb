"""Cases: dropped sessions or tables and the progress of the work on them, a folder each.

DATA/cases/20261124-221530-3f2a/
case.json       the `Case`
bag/NAME        the session as dropped; mended-1/NAME after it was mended
STEP.out, .err  standard output and standard error of the step's verb
verdict.json, extended.yaml, report.html, ...
"""

from __future__ import annotations

import json
import os
import re
import secrets
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from threading import RLock
from typing import Any

from delta_calibration.errors import InputError
from delta_calibration.files import written_whole

WORKING, ASKING, DONE, FAILED, STOPPED = "working", "asking", "done", "failed", "stopped"
BAG, TABLE, LOG = "bag", "table", "log"
_FILE = "case.json"
_ID = re.compile(r"\d{8}-\d{6}-[0-9a-f]{4}")


@dataclass(frozen=True)
class Case:
    """One piece of work of the bench: a session, a table or a change log.

    Attributes:
        id: name of its folder.
        kind: what was requested: `bag`, `table`, or `log` (the change log of a machine).
        name: name of the session, from its file's name.
        machine: machine in the history; empty if the session is not to be kept.
        robot: name of a robot, or path of its file relative to the case's folder.
        began: time when it was dropped, ISO 8601 in UTC.
        state: `working`, `asking` (a question waits), `done`, `failed` or `stopped`.
        step: step that is running; empty if none is.
        waiting: steps to come, in order.
        session: path of the current session, relative to the case's folder; empty if none yet.
        topics: topics with non-standard names, as STREAM=TOPIC.
        forced: whether to go on in spite of mistakes that the check found.
        question: question that waits for an answer: `columns` or `mistakes`; empty if none.
        said: reason of a failure or question, or a message of the last step; a sentence.
        mended: number of times that the session was mended.
        options: further values that the user gave for the steps, by name.
        version: number of changes, so that a page knows when to reload.
    """

    id: str
    kind: str
    name: str
    machine: str
    robot: str
    began: str
    state: str = WORKING
    step: str = ""
    waiting: tuple[str, ...] = ()
    session: str = ""
    topics: tuple[str, ...] = ()
    forced: bool = False
    question: str = ""
    said: str = ""
    mended: int = 0
    options: dict[str, str] | None = None
    version: int = 0

    def option(self, name: str, default: str = "") -> str:
        """Value that the user gave under this name."""
        return (self.options or {}).get(name, default)

    @property
    def at_rest(self) -> bool:
        """Whether the case has ended, so that exports can be requested."""
        return self.state in (DONE, FAILED, STOPPED)


class Cases:
    """The cases of a data folder; may be used by several threads of one process."""

    def __init__(self, folder: Path) -> None:
        """Use the cases in a folder; the folder is created if missing."""
        self._folder = folder
        self._lock = RLock()
        folder.mkdir(parents=True, exist_ok=True)

    def new_id(self) -> str:
        """Create the folder of a new case and return its unique id."""
        while True:
            now = datetime.now(timezone.utc)
            id_ = f"{now:%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
            try:
                (self._folder / id_).mkdir()
            except FileExistsError:
                continue
            return id_

    def folder(self, id_: str) -> Path:
        """Folder of a case.

        Raises:
            InputError: no such case.
        """
        folder = self._folder / id_
        if not _ID.fullmatch(id_) or not folder.is_dir():
            raise InputError(f"there is no session {id_!r} on this bench")
        return folder

    def add(self, case: Case) -> None:
        """Write a new case to the folder that `new_id` created."""
        with self._lock:
            self._write(case)

    def get(self, id_: str) -> Case:
        """Read the present state of a case.

        Raises:
            InputError: no such case.
        """
        path = self.folder(id_) / _FILE
        with self._lock:
            try:
                data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            except FileNotFoundError as error:
                raise InputError(f"there is no session {id_!r} on this bench") from error
        data["waiting"], data["topics"] = tuple(data["waiting"]), tuple(data["topics"])
        return Case(**data)

    def all(self) -> tuple[Case, ...]:
        """All cases, the newest first; folders without a case file are skipped."""
        ids = sorted(
            (p.name for p in self._folder.iterdir() if _ID.fullmatch(p.name)), reverse=True
        )
        return tuple(self.get(id_) for id_ in ids if (self._folder / id_ / _FILE).is_file())

    def change(self, id_: str, change: Callable[[Case], Case]) -> Case:
        """Replace a case by its changed version; an exception in `change` leaves it unchanged."""
        with self._lock:
            before = self.get(id_)
            after = change(before)
            if after == before:
                return before
            after = replace(after, version=before.version + 1)
            self._write(after)
            return after

    def _write(self, case: Case) -> None:
        with written_whole(self._folder / case.id / _FILE, lasting=True) as beside:
            beside.write_text(json.dumps(asdict(case), indent=1), encoding="utf-8")


def file_name(given: str, default: str, longest: int = 80) -> str:
    """Return a safe file or session name from one a browser sent: no path, no hidden file."""
    bare = os.path.basename(given.replace("\\", "/"))
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", bare).strip("._-")
    return plain[:longest].rstrip("._-") or default
