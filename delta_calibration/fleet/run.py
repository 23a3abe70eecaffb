"""A fleet worked through on a Dask cluster, its results written by this process alone.

Only so many sessions are on their way at once (`AHEAD` a thread of the cluster): the scheduler's
memory does not grow with the fleet. Sessions of few places are fitted when all others of their
machine are there, the earliest first, and the sessions of a machine are compared as soon as the
last of them is there. A worker that is lost has its sessions done again by another; one that takes
three workers with it is a failure of that session.
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

AHEAD = 3  # sessions on their way for each thread of the cluster
_RETRIES = 2  # of work that ends by an error that is no result: a disk or a network that fails
_LONGEST = 60.0  # [s] until a scheduler has to answer

Result = Entry | Failure | There | Compared


@dataclass(frozen=True)
class Settings:
    """How a fleet is worked through."""

    quick: bool = False  # fit only
    again: bool = False  # try sessions that failed once more
    compare: bool = True  # find out what changed between the sessions of each machine
    seed: int = 0


@dataclass
class _Course:
    """What is still to come of a run."""

    machines: dict[str, Machine]
    hashes: dict[str, str]  # of their robots
    left: Counter[str]
    few: defaultdict[str, list[Few]] = field(default_factory=lambda: defaultdict(list))
    of: dict[Future[Any], tuple[str, Place | None]] = field(default_factory=dict)


@contextmanager
def cluster(scheduler: str | None, workers: int | None, memory_gb: float) -> Iterator[Client]:
    """A client of a scheduler, or of a local cluster of one thread a process.

    Args:
        scheduler: its address; a local cluster is started where none is given.
        workers: processes of the local cluster, as many as cores where not given.
        memory_gb: of each; one that needs more is ended and begun anew.

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
                silence_logs=logging.CRITICAL,  # what is lost is told as a result
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
    """Work through the sessions of machines and write what is found.

    Args:
        client: of the cluster.
        machines: with their sessions.
        ledger: where results are written, and what of it is done.
        settings: what is done with a session.
        tell: is told each result and whether it was written just now.
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
    """What can be done of a machine now that another of its sessions is there."""
    few, left = course.few[machine], course.left[machine]
    if few and left == len(few):  # all others are there
        few.sort(key=lambda each: each.began)
        known = machine in dict(ledger.store.machines())
        there = ledger.store.sessions(machine) if known else ()
        return (Update(few.pop(0).job, there),)
    if left or not settings.compare:
        return ()
    comparison = _comparison(course.machines[machine], ledger)
    return () if comparison is None else (comparison,)


def machines_of(store: Store) -> tuple[Machine, ...]:
    """The machines of a history, as it knows them."""
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
    """Hash of each machine's robot; where it is none, or another than before, it has failed."""
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
    """What came of it; an error that is no result, or the loss of three workers, is told."""
    if future.status == "finished":
        result: Result | Few = future.result()
        return result
    told = f"{type(future.exception()).__name__}: {future.exception()}".splitlines()[0]
    if place is None:
        return Compared(machine, "", (), told)
    return Failure(machine, place.id, "", told)


def _written(result: Result, course: _Course, ledger: Ledger) -> tuple[Result, bool]:
    """Write a result; what it is then, and whether it is new."""
    if isinstance(result, Entry):
        if ledger.taken(result):
            told = (
                f"{result.path}: another session of machine {result.machine!r} has its name, or "
                "it was changed since; give it a name of its own"
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
    """What is to be compared of a machine, unless it was or there is only one session."""
    hashes = ledger.done(machine.name, quick=True)
    known = ledger.compared(machine.name).get(machine.name)
    same = known is not None and known.sessions_sha256 == hash_of_sessions(hashes)
    if len(hashes) < 2 or same:
        return None
    return Comparison(machine.name, machine.robot, ledger.store.sessions(machine.name))
