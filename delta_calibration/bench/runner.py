"""Run the steps of cases as child processes, in the order in which the cases were queued.

A step is `python -m delta_calibration.cli.main VERB ...` in the folder of its case, with its
output in two files there. The child leads its own process group, so that it and all processes it
started can be ended. A step that the end of the server interrupted is repeated by the next server.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from queue import SimpleQueue
from threading import Lock, Thread

from delta_calibration.bench.cases import STOPPED, WORKING, Case, Cases
from delta_calibration.bench.flow import (
    EXTRAS,
    Said,
    again,
    arguments,
    begun,
    ended,
    last_line,
    made_anew,
)
from delta_calibration.processes import child_environment

_PATIENCE_S = 5.0  # for a step to end after each signal
_COMMANDS, _LOCK = "commands.txt", "lock"
_MOST_TOLD = 200_000  # most bytes that are read of a step's output
_STEP = re.compile(r"step (\d+) of (\d+), (.+): after \d+ s")
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)


@dataclass(frozen=True)
class Doing:
    """Progress of a step: number and name of its present part, and the number of parts."""

    number: int
    of: int
    name: str


class Runner:
    """Workers that run the steps of queued cases until closed."""

    def __init__(self, cases: Cases, store: str, workers: int = 1) -> None:
        """Start the workers, and queue the cases that were left unfinished.

        Args:
            cases: cases to work on.
            store: absolute path or URL of the history.
            workers: number of cases that are processed at once.
        """
        self._cases, self._store = cases, store
        self._waiting: SimpleQueue[str | None] = SimpleQueue()
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._lock, self._closed = Lock(), False
        self._active: set[str] = set()  # cases that a worker is processing
        self._threads = [Thread(target=self._work, daemon=True) for _ in range(workers)]
        for case in reversed(cases.all()):
            if case.state == WORKING:
                cases.change(case.id, again)
                self.take(case.id)
        for thread in self._threads:
            thread.start()

    def take(self, id_: str) -> None:
        """Queue a case that has steps waiting."""
        self._waiting.put(id_)

    def stop(self, id_: str) -> None:
        """Stop a case; its results so far are kept."""
        self._cases.change(id_, _stopped)
        with self._lock:
            child = self._children.get(id_)
        if child is not None:
            _end(child)

    def close(self) -> None:
        """End the running steps; the next runner repeats them."""
        with self._lock:
            self._closed = True
            children = list(self._children.values())
        for child in children:
            _end(child)
        for _ in self._threads:
            self._waiting.put(None)
        for thread in self._threads:
            thread.join()

    def _work(self) -> None:
        while (id_ := self._waiting.get()) is not None:
            while self._work_on(id_):
                pass

    def _work_on(self, id_: str) -> bool:
        """Run a case's steps unless another worker does; returns whether new ones are waiting."""
        with self._lock:
            if id_ in self._active:
                return False
            self._active.add(id_)
        try:
            while not self._closed and self._step(id_):
                pass
        finally:
            with self._lock:
                self._active.discard(id_)
        return not self._closed and _has_work(self._cases.get(id_))

    def _step(self, id_: str) -> bool:
        """Run one step; returns whether another one is waiting."""
        case = self._cases.change(id_, lambda c: begun(c) if _has_work(c) else c)
        if case.state != WORKING or not case.step:
            return False
        folder = self._cases.folder(id_)
        said = self._run(case, folder)
        if self._closed:
            return False
        after = self._cases.change(
            id_, lambda c: ended(c, said, folder) if c.state == WORKING else c
        )
        return _has_work(after)

    def _run(self, case: Case, folder: Path) -> Said:
        """Run the verb of a case's step and wait for its end."""
        out, err = (folder / f"{case.step}.{kind}" for kind in ("out", "err"))
        with (
            (folder / _LOCK).open("w") as lock,
            out.open("wb") as output,
            err.open("wb") as errors,
        ):
            # The child holds the lock too: a child that outlived a killed server is waited for.
            fcntl.flock(lock, fcntl.LOCK_EX)
            clear(case, folder)
            verb = arguments(case, case.step, self._store)
            with self._lock:
                if self._closed or self._cases.get(case.id).state != WORKING:
                    return Said(-signal.SIGINT, "", "stopped before it began")
                child = subprocess.Popen(
                    command(verb),
                    cwd=folder,
                    env=child_environment(),
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=errors,
                    pass_fds=(lock.fileno(),),
                    start_new_session=True,
                )
                self._children[case.id] = child
            _note(folder, verb)
            code = child.wait()
            with self._lock:
                del self._children[case.id]
        return Said(code, _read(out), _sentence(_read(err), code))


def clear(case: Case, folder: Path) -> None:
    """Create the folders that a step's verb needs, and delete the results of an earlier try."""
    for name in EXTRAS.get(case.step, ()):
        (folder / name).unlink(missing_ok=True)
    for name in made_anew(case):
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir()


def command(verb: Sequence[str]) -> list[str]:
    """Command line that runs a verb with this Python interpreter."""
    return [sys.executable, "-m", "delta_calibration.cli.main", *verb]


def doing(folder: Path, step: str) -> Doing | None:
    """Progress of a step of a case; None if its verb does not report any."""
    lines = _STEP.findall(_read(folder / f"{step}.err"))
    if not lines:
        return None
    number, of, name = lines[-1]
    return Doing(int(number), int(of), name)


def told(folder: Path, step: str) -> str:
    """Standard output of a step's verb; empty if it did not run."""
    return _read(folder / f"{step}.out")


def commands(folder: Path) -> list[str]:
    """Command lines that were run in a case's folder, as a user would type them."""
    return _read(folder / _COMMANDS).splitlines()


def _note(folder: Path, verb: Sequence[str]) -> None:
    with (folder / _COMMANDS).open("a", encoding="utf-8") as file:
        file.write(f"delta-cal {shlex.join(verb)}\n")


def _has_work(case: Case) -> bool:
    return case.state == WORKING and bool(case.waiting)


def _stopped(case: Case) -> Case:
    if case.at_rest:
        return case
    return replace(case, state=STOPPED, waiting=(), question="", said="stopped by you")


def _read(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return file.read(_MOST_TOLD).decode("utf-8", "replace")
    except FileNotFoundError:
        return ""


def _sentence(errors: str, code: int) -> str:
    """Reason of a verb's failure, without the program name before it; empty after success."""
    if code < 0:
        return f"ended by signal {-code}"
    return re.sub(r"^(delta-cal|Error): ", "", last_line(errors)) if code else ""


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a child and all processes it started, by SIGINT, then SIGTERM, then SIGKILL."""
    for order in _SIGNALS:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, order)
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(_PATIENCE_S)
            return
