"""Throughput of a fleet run: measured here, and simulated for more workers.

The processor times of these are measured: the work on one session, the comparison of a machine's
sessions, Dask's overhead for an empty task, and writing and reading a result. The run is then
simulated with these times: workers that each do one task at a time; AHEAD sessions per worker
submitted in advance; one process that submits tasks, receives results and writes them, one after
the other.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

from distributed import Client

from delta_calibration.fleet.places import machines_in, robot_file
from delta_calibration.fleet.run import AHEAD, Settings, cluster, run
from delta_calibration.fleet.work import Comparison, Job, compare, examine
from delta_calibration.history.ledger import Ledger
from delta_calibration.history.store import Entry, open_store
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot
from delta_calibration.simulation import days_later, draw_machine, simulate_session, visited
from delta_calibration.threads import one_thread

NOTHINGS = 300  # empty tasks
MACHINES, DAYS = 4, 24  # of the fleet that is fitted here
WORKERS = (1, 8, 32, 128, 512)


@dataclass(frozen=True)
class Times:
    """Processor times [s]."""

    session: float  # of a worker, per session
    comparison: float  # of a worker, per session compared
    task: float  # of client and scheduler, per task
    write: float  # of the writing process, per result
    read: float  # of the writing process, per session to be compared


def sessions(robot: Robot, folder: Path, machines: int, days: int) -> None:
    """Write a folder of machines, each measured on several days."""
    for number in range(machines):
        for day in range(days):
            machine = visited(draw_machine(robot, number), robot, number, day + 1)
            plan = make_plan("identify", robot, count=24, seed=1)
            recorded = days_later(simulate_session(machine, plan, 100 * number + day), day)
            write_session(folder / f"machine_{number}" / f"day_{day}", recorded, {})


def throughput(robot: Robot, most: int) -> None:
    """Print sessions per second with 1 to `most` local workers, and a worker's memory."""
    with TemporaryDirectory() as place:
        sessions(robot, Path(place) / "fleet", MACHINES, DAYS)
        machines = machines_in(str(Path(place) / "fleet"), robot_file("srbd"))
        first = Job("first", machines[0].sessions[0], machines[0].robot, frozenset(), None, True)
        for workers in range(1, most + 1):
            url = str(Path(place) / f"{workers}.sqlite")
            with open_store(url, make=True) as store, cluster(None, workers, 2.0) as client:
                client.run(examine, first)  # exclude what a worker loads once
                begun = perf_counter()
                settings = Settings(quick=True, compare=False)
                run(client, machines, Ledger(store), settings, lambda *_: None)
                took = perf_counter() - begun
                memory = max(client.run(peak_memory).values())
            print(
                f"{workers} workers: {MACHINES * DAYS / took:.2f} sessions a second (fit only); "
                f"most memory of a worker {memory / 1e6:.0f} MB"
            )


def peak_memory() -> float:
    """Peak memory of this process [bytes]."""
    return 1024.0 * getrusage(RUSAGE_SELF).ru_maxrss


def measure(robot: Robot, quick: bool) -> Times:
    """Measure the times, each the median of a few."""
    with TemporaryDirectory() as place:
        sessions(robot, Path(place) / "fleet", 1, 6)
        (machine,) = machines_in(str(Path(place) / "fleet"), robot_file("srbd"))
        jobs = [
            Job(machine.name, each, machine.robot, frozenset(), None, quick)
            for each in machine.sessions
        ]
        examine(jobs[0])  # exclude what is compiled and loaded once
        took, found = _each([lambda job=job: examine(job) for job in jobs[:3]])
        fits = [examine(replace(job, quick=True)) for job in jobs]
        entries = tuple(each for each in fits if isinstance(each, Entry))
        comparison = Comparison(machine.name, machine.robot, entries)
        compared, _ = _each([lambda: compare(comparison)] * 2)
        with open_store(str(Path(place) / "h.sqlite"), make=True) as store:
            ledger = Ledger(store)
            entry = found[0]
            assert isinstance(entry, Entry)
            copies = [replace(entry, id=str(n), sha256=f"{n:064d}") for n in range(100)]
            write, _ = _each(
                [lambda c=c: ledger.keep(c, "srbd", robot.machine_hash) for c in copies]
            )
            read, _ = _each([lambda: store.sessions(machine.name)] * 3)
            read /= len(copies)
    return Times(took, compared / len(entries), task_time(), write, read)


def _each(works: list[Callable[[], object]]) -> tuple[float, list[object]]:
    """Median processor time of several calls, and their results."""
    times, results = [], []
    for work in works:
        begun = process_time()
        with one_thread():  # as in a worker
            results.append(work())
        times.append(process_time() - begun)
    return median(times), results


def task_time() -> float:
    """Processor time of client and scheduler for an empty task [s]."""
    with Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as client:
        client.gather(client.map(abs, range(10), pure=False))
        begun = process_time()
        for number in range(NOTHINGS):  # as in a run: one result, one new task
            client.submit(abs, number, pure=False).result()
        return (process_time() - begun) / NOTHINGS


def simulated(times: Times, workers: int, machines: int, days: int) -> tuple[float, float]:
    """Duration of a run [h], and the share of it for which the writing process is busy."""
    free = [0.0] * workers  # time at which each worker becomes free
    coming: list[tuple[float, int]] = []  # time of a result, and its machine; -1: none
    left = [days] * machines
    todo, handed, ahead = machines * days, 0, AHEAD * workers
    now = busy = 0.0

    def start(seconds: float, machine: int) -> None:
        begins = max(heapq.heappop(free), now)
        heapq.heappush(free, begins + seconds)
        heapq.heappush(coming, (begins + seconds, machine))

    for number in range(min(ahead, todo)):
        now += times.task
        busy += times.task
        start(times.session, number // days)
        handed += 1
    while coming:
        ready, machine = heapq.heappop(coming)
        serial = times.write if machine >= 0 else 0.0
        if machine >= 0:
            left[machine] -= 1
            if handed < todo:
                serial += times.task
        whole = machine >= 0 and left[machine] == 0
        serial += (times.task + times.read * days) if whole else 0.0
        now = max(now, ready) + serial
        busy += serial
        if machine >= 0 and handed < todo:
            start(times.session, handed // days)
            handed += 1
        if whole:
            start(times.comparison * days, -1)
    return now / 3600, busy / now


def scale(robot: Robot, machines: int, days: int) -> None:
    """Print the duration of runs by number of workers, with diagnosis and with fit only."""
    for quick in (False, True):
        times = measure(robot, quick)
        print(
            f"{'fit only' if quick else 'diagnosis'}: session {times.session:.2f} s, comparison "
            f"{times.comparison:.2f} s a session, task {1e3 * times.task:.2f} ms, write "
            f"{1e3 * times.write:.2f} ms, read {1e3 * times.read:.2f} ms a session"
        )
        first = None
        for workers in WORKERS:
            hours, share = simulated(times, workers, machines, days)
            first = first or hours
            print(
                f"{workers:6d} workers: {hours:10.2f} h, {first / hours:7.1f} times one, "
                f"{100 * first / hours / workers:5.1f} % of them, "
                f"writer busy {100 * share:5.1f} %",
                flush=True,
            )
    print(f"peak memory of this process {peak_memory() / 1e6:.0f} MB")
