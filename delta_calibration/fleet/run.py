"""Process the sessions of a fleet on a Dask cluster; only this process writes the results.

The number of submitted sessions is limited (`AHEAD` per thread of the cluster), so that the
scheduler's memory does not grow with the fleet. Sessions with few places are fitted, the earliest
first, when all others of their machine are done; the sessions of a machine are compared when its
last one is done. If a worker is lost, its sessions are processed again by another one. A session
that repeatedly kills its worker fails (Dask's `allowed-failures`: 3 deaths are retried).
"""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from distributed import Client, Future, LocalCluster, as_completed

from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.fleet.places import Machine, Place, robot_file
from delta_calibration.fleet.work import (
    Comparison,
    Few,
    Job,
    There,
    Update,
    compare,
    examine,
    update,
)
from delta_calibration.history.ledger import Compared, Failure, Ledger, hash_of_sessions
from delta_calibration.history.store import Entry, Store
from delta_calibration.robot import robot_from

AHEAD = 3  # submitted sessions per thread of the cluster
_RETRIES = 2  # retries after an unexpected error, such as of a disk or network
_LONGEST = 60.0  # [s] timeout for the scheduler's answer

Result = Entry | Failure | There | Compared


@dataclass(frozen=True)
class Settings:
    """Settings of a fleet run."""

    quick: bool = False  # fit only
    again: bool = False  # try failed sessions once more
    compare: bool = True  # find changes between the sessions of each machine
    seed: int = 0


@dataclass
class _Course:
    """Open work of a run: sessions left, sessions with few places, and submitted work."""

    machines: dict[str, Machine]
    hashes: dict[str, str]  # of their robots
    left: Counter[str]
    few: defaultdict[str, list[Few]] = field(default_factory=lambda: defaultdict(list))
    of: dict[Future[Any], tuple[str, Place | None]] = field(default_factory=dict)


@contextmanager
def cluster(scheduler: str | None, workers: int | None, memory_gb: float) -> Iterator[Client]:
    """Yield a client of a scheduler, or of a local cluster with one thread per process.

    Args:
        scheduler: address of the scheduler; if None, a local cluster is started.
        workers: processes of the local cluster; by default one per core.
        memory_gb: memory limit of each process; one that exceeds it is restarted.

    Raises:
        InputError: no scheduler answers there.
    """
    if scheduler is None:
        limit = int(memory_gb * 1e9)
        with (
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=limit,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,  # a lost worker is reported as a result
            ) as own,
            Client(own) as client,
        ):
            yield client
        return
    try:
        client = Client(scheduler, timeout=_LONGEST)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"--scheduler {scheduler}: no scheduler answers: {error}") from error
    with client:
        yield client


def run(
    client: Client,
    machines: Sequence[Machine],
    ledger: Ledger,
    settings: Settings,
    tell: Callable[[Result, bool], None],
) -> None:
    """Process the sessions of machines and write the results.

    Args:
        client: client of the cluster.
        machines: machines with their sessions.
        ledger: store of the results; sessions that it already has are skipped.
        settings: what is done with each session.
        tell: callback for each result, with a flag whether it was written just now.
    """
    hashes = _robots(machines, ledger, tell)
    sound = [each for each in machines if each.name in hashes]
    course = _Course(
        {each.name: each for each in sound},
        hashes,
        Counter({each.name: len(each.sessions) for each in sound}),
    )
    jobs = _jobs(sound, ledger, settings)
    window = AHEAD * max(1, sum(client.nthreads().values()))
    coming = as_completed([])
    for job in islice(jobs, window):
        coming.add(_submitted(client, course, job))
    for future in coming:
        machine, place = course.of.pop(future)
        result = _result(future, machine, place)
        future.release()
        if isinstance(result, Few):
            course.few[machine].append(result)
        else:
            result, new = _written(result, course, ledger)
            tell(result, new)
            course.left[machine] -= place is not None
        if place is not None:
            further = (*islice(jobs, 1), *_behind(course, machine, ledger, settings))
            for work in further:
                coming.add(_submitted(client, course, work))


def _behind(
    course: _Course, machine: str, ledger: Ledger, settings: Settings
) -> tuple[Update | Comparison, ...]:
    """Work on a machine that has become possible because another of its sessions is done."""
    few, left = course.few[machine], course.left[machine]
    if few and left == len(few):  # all others are done
        few.sort(key=lambda each: each.began)
        known = machine in dict(ledger.store.machines())
        there = ledger.store.sessions(machine) if known else ()
        return (Update(few.pop(0).job, there),)
    if left or not settings.compare:
        return ()
    comparison = _comparison(course.machines[machine], ledger)
    return () if comparison is None else (comparison,)


def machines_of(store: Store) -> tuple[Machine, ...]:
    """List the machines of a history with their sessions."""
    return tuple(
        Machine(
            name,
            robot_file(robot),
            tuple(Place(e.id, e.path, e.topics) for e in store.sessions(name)),
        )
        for name, robot in store.machines()
    )


def _robots(
    machines: Sequence[Machine], ledger: Ledger, tell: Callable[[Result, bool], None]
) -> dict[str, str]:
    """Hash of each valid robot, by machine; a bad or changed robot file fails its sessions."""
    known, hashes = ledger.made_for(), {}
    for machine in machines:
        given = machine.robot.given
        try:
            digest = robot_from(machine.robot.document, given).machine_hash
            before, made_for = known.get(machine.name, (given, digest))
            if made_for != digest:
                raise InputError(
                    f"machine {machine.name!r} is of robot {before!r} with hash {made_for[:12]}; "
                    f"{given} has hash {digest[:12]}: another robot, or its file was changed"
                )
        except CalibrationError as error:
            for place in machine.sessions:
                failure = Failure(machine.name, place.id, "", str(error))
                ledger.fail(failure)
                tell(failure, True)
            continue
        hashes[machine.name] = digest
    return hashes


def _jobs(machines: Sequence[Machine], ledger: Ledger, settings: Settings) -> Iterator[Job]:
    failed = {} if settings.again else {(f.machine, f.id): f.sha256 for f in ledger.failures()}
    for machine in machines:
        done = ledger.done(machine.name, settings.quick)
        for place in machine.sessions:
            yield Job(
                machine.name,
                place,
                machine.robot,
                done,
                failed.get((machine.name, place.id)) or None,
                settings.quick,
                settings.seed,
            )


def _submitted(client: Client, course: _Course, work: Job | Update | Comparison) -> Future[Any]:
    done_by: Any = {Job: examine, Update: update, Comparison: compare}[type(work)]
    future = client.submit(done_by, work, pure=False, retries=_RETRIES)
    course.of[future] = (work.machine, work.place)
    return future


def _result(future: Future[Any], machine: str, place: Place | None) -> Result | Few:
    """Result of finished work; an unexpected error or lost workers give a failure."""
    if future.status == "finished":
        result: Result | Few = future.result()
        return result
    told = f"{type(future.exception()).__name__}: {future.exception()}".splitlines()[0]
    if place is None:
        return Compared(machine, "", (), told)
    return Failure(machine, place.id, "", told)


def _written(result: Result, course: _Course, ledger: Ledger) -> tuple[Result, bool]:
    """Write a result; returns it, or a failure if its id is taken, and whether it was written."""
    if isinstance(result, Entry):
        if ledger.taken(result):
            told = (
                f"{result.path}: machine {result.machine!r} has another session of this name, "
                "or the session was changed since; give it another name"
            )
            result = Failure(result.machine, result.id, result.sha256, told)
        else:
            name = result.machine
            given = course.machines[name].robot.given
            return result, ledger.keep(result, given, course.hashes[name])
    if isinstance(result, Failure):
        ledger.fail(result)
    if isinstance(result, Compared):
        ledger.keep_compared(result)
    return result, not isinstance(result, There)


def _comparison(machine: Machine, ledger: Ledger) -> Comparison | None:
    """Comparison of a machine's sessions; None if it is up to date, or for a single session."""
    hashes = ledger.done(machine.name, quick=True)
    known = ledger.compared(machine.name).get(machine.name)
    same = known is not None and known.sessions_sha256 == hash_of_sessions(hashes)
    if len(hashes) < 2 or same:
        return None
    return Comparison(machine.name, machine.robot, ledger.store.sessions(machine.name))
