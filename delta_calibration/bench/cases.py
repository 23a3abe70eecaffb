"""Cases: what was dropped, and how far the work on it is; a folder each, on disk.

DATA/cases/20261124-221530-3f2a/
case.json       the `Case`
bag/NAME        the session as it was dropped; mended-1/NAME once it was mended
STEP.out, .err  what the verb of a step said
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
    """One thing that the bench works on.

    Attributes:
        id: name of its folder.
        kind: what it began as: `bag`, `table`, or `log`, the change log of a machine.
        name: of the session, as its file was called.
        machine: the machine in the history; empty where it is not to be kept.
        robot: name of a robot, or path of its file, from the case's folder.
        began: when it was dropped, ISO 8601 in UTC.
        state: `working`, `asking` (a question waits), `done`, `failed` or `stopped`.
        step: that is worked on; empty where none is.
        waiting: steps to come, in order.
        session: path of the session in force, from the case's folder; empty while there is none.
        topics: where streams were recorded under another name, as STREAM=TOPIC.
        forced: whether to go on over mistakes that the check found.
        question: that waits for an answer: `columns` or `mistakes`; empty where none does.
        said: why it failed or asks, or what the last step has to say; a sentence.
        mended: how often the session was mended.
        options: what else the page was given for its steps, by name.
        version: counts changes, so that a page knows when to look again.
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
        """What the page was given by this name."""
        return (self.options or {}).get(name, default)

    @property
    def at_rest(self) -> bool:
        """Whether nothing is worked on, so that more can be asked for."""
        return self.state in (DONE, FAILED, STOPPED)


class Cases:
    """The cases of a data folder; may be used by several threads of one process."""

    def __init__(self, folder: Path) -> None:
        """The cases in a data folder; the folder is created if missing."""
        self._folder = folder
        self._lock = RLock()
        folder.mkdir(parents=True, exist_ok=True)

    def new_id(self) -> str:
        """An id that no case has, its folder made."""
        while True:
            now = datetime.now(timezone.utc)
            id_ = f"{now:%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
            try:
                (self._folder / id_).mkdir()
            except FileExistsError:
                continue
            return id_

    def folder(self, id_: str) -> Path:
        """Where a case lives.

        Raises:
            InputError: no such case.
        """
        folder = self._folder / id_
        if not _ID.fullmatch(id_) or not folder.is_dir():
            raise InputError(f"there is no session {id_!r} on this bench")
        return folder

    def add(self, case: Case) -> None:
        """Keep a new case, in the folder that `new_id` made."""
        with self._lock:
            self._write(case)

    def get(self, id_: str) -> Case:
        """A case as it is now.

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
        """Every case, the newest first; a folder that never became one is passed over."""
        ids = sorted(
            (p.name for p in self._folder.iterdir() if _ID.fullmatch(p.name)), reverse=True
        )
        return tuple(self.get(id_) for id_ in ids if (self._folder / id_ / _FILE).is_file())

    def change(self, id_: str, change: Callable[[Case], Case]) -> Case:
        """Put another case in the place of one; what the change raises leaves it as it was."""
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
