"""A fleet on a cluster: nothing lost or done twice, bad sessions reported, runs can be resumed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from delta_calibration.cli.main import run as run_verb
from delta_calibration.errors import InputError
from delta_calibration.plans import make_plan
from delta_calibration.processes import child_environment
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import days_later, draw_machine, simulate_session, visited

pytest.importorskip("sqlalchemy")
pytest.importorskip("distributed")
pytest.importorskip("fsspec")

import distributed
import fsspec

from delta_calibration.fleet.places import Machine, machines_in, robot_file
from delta_calibration.fleet.run import Result, Settings, machines_of, run
from delta_calibration.fleet.run import cluster as local_cluster
from delta_calibration.fleet.work import There
from delta_calibration.history.ledger import Compared, Failure, Ledger
from delta_calibration.history.store import Entry, open_store

ROOT = Path(__file__).parents[1]
QUICK = Settings(quick=True)
ONCE = Settings(quick=True, compare=False)
SESSIONS = 4  # for each of two machines


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("srbd")


@pytest.fixture(scope="module")
def folder(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two machines measured on four days each; an arm of the first grows after the second day."""
    folder = tmp_path_factory.mktemp("fleet")
    for number, name in enumerate(("press_1", "press_2")):
        for day in range(SESSIONS):
            grown = name == "press_1" and day > 1
            causes = {"arm_length": {"location": "joint_2", "value": "1e-4"}} if grown else {}
            machine = visited(draw_machine(robot, number, 1.0, causes), robot, number, day + 1)
            plan = make_plan("identify", robot, count=24, seed=1)
            session = days_later(simulate_session(machine, plan, 10 * number + day), day)
            write_session(folder / name / f"day_{day}", session, {})
    return folder


@pytest.fixture(scope="module")
def client() -> Iterator[distributed.Client]:
    """A cluster of one thread in this process, which can see memory://."""
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as client:
        yield client


class Heard:
    """Records the results of a run."""

    def __init__(self) -> None:
        self.results: list[tuple[Result, bool]] = []

    def __call__(self, result: Result, new: bool) -> None:
        self.results.append((result, new))

    def of(self, kind: type) -> list[Result]:
        return [result for result, _ in self.results if isinstance(result, kind)]

    def added(self) -> list[str]:
        return [f"{r.machine}/{r.id}" for r, new in self.results if new and isinstance(r, Entry)]


def machines(folder: Path | str) -> tuple[Machine, ...]:
    return machines_in(str(folder), robot_file("srbd"))


ALL = sorted(f"press_{n}/day_{day}" for n in (1, 2) for day in range(SESSIONS))


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, dict[str, subprocess.Popen[bytes]]]]:
    """A scheduler and two workers, each a process: its address, and the workers by name."""
    file, environment = tmp_path / "scheduler.json", child_environment()
    environment["PYTHONPATH"] = str(ROOT)
    log = (tmp_path / "cluster.log").open("wb")

    def started(module: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments]
        return subprocess.Popen(command, env=environment, stdout=log, stderr=log)

    scheduler = started(
        "dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--scheduler-file", str(file),
        "--no-dashboard",
    )  # fmt: skip
    workers = {
        name: started(
            "dask_worker", "--scheduler-file", str(file), "--name", name, "--nthreads", "1",
            "--no-nanny", "--no-dashboard",
        )
        for name in ("one", "two")
    }  # fmt: skip
    try:
        with distributed.Client(scheduler_file=str(file), timeout=60) as client:
            client.wait_for_workers(2, timeout=60)
            address = client.scheduler.address
        yield address, workers
    finally:
        for process in (*workers.values(), scheduler):
            process.kill()
            process.wait()
        log.close()


def test_a_local_cluster_has_as_many_workers_as_are_asked_for() -> None:
    asked = (os.cpu_count() or 1) + 1  # another number than the default
    with local_cluster(None, asked, 1.0) as client:
        assert len(client.nthreads()) == asked


class Disturbed(Heard):
    """Kills the worker with most work at the first result; stops at the third."""

    def __init__(
        self, client: distributed.Client, workers: dict[str, subprocess.Popen[bytes]]
    ) -> None:
        super().__init__()
        self.client, self.workers, self.lost = client, workers, 0

    def __call__(self, result: Result, new: bool) -> None:
        super().__call__(result, new)
        if len(self.results) == 1:
            busy = {k: len(v) for k, v in self.client.processing().items()}
            address = max(busy, key=lambda each: busy[each])
            self.lost = busy[address]
            name = self.client.scheduler_info(n_workers=-1)["workers"][address]["name"]
            self.workers[name].send_signal(signal.SIGKILL)
        if len(self.results) == 3:
            raise KeyboardInterrupt


@pytest.mark.slow
def test_a_killed_worker_and_a_stop_lose_nothing_and_write_nothing_twice(
    folder: Path,
    tmp_path: Path,
    cluster: tuple[str, dict[str, subprocess.Popen[bytes]]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    address, workers = cluster
    store_file = str(tmp_path / "h.sqlite")
    with open_store(store_file, make=True) as store, distributed.Client(address) as client:
        disturbed = Disturbed(client, workers)
        with pytest.raises(KeyboardInterrupt):
            run(client, machines(folder), Ledger(store), ONCE, disturbed)
    assert disturbed.lost > 0, "the worker that was killed had nothing to do"
    assert [w.poll() for w in workers.values()].count(-signal.SIGKILL) == 1
    with open_store(store_file) as store, distributed.Client(address) as client:
        before = [e.id for name, _ in store.machines() for e in store.sessions(name)]
        assert len(before) == 3
        heard = Heard()
        run(client, machines(folder), Ledger(store), ONCE, heard)
        assert sorted(disturbed.added() + heard.added()) == ALL
        assert len(heard.of(There)) == 3
        kept = [f"{n}/{e.id}" for n, _ in store.machines() for e in store.sessions(n)]
    assert sorted(kept) == ALL
    verb = ["fleet", str(folder), "--robot", "srbd", "--scheduler", address]
    assert run_verb([*verb, "--store", store_file, "--quick", "--no-changes"]) == 0
    assert "0 sessions added, 8 already there, 0 failed" in capsys.readouterr().out


def test_sessions_in_memory_are_fitted_compared_and_not_done_again(
    folder: Path, tmp_path: Path, client: distributed.Client
) -> None:
    memory = fsspec.filesystem("memory")
    memory.put(str(folder), "/fleet", recursive=True)
    try:
        with open_store(str(tmp_path / "h.sqlite"), make=True) as store:
            ledger, first, again = Ledger(store), Heard(), Heard()
            run(client, machines("memory://fleet"), ledger, QUICK, first)
            run(client, machines("memory://fleet"), ledger, QUICK, again)
            compared = ledger.compared()
            assert store.sessions("press_1")[0].path == "memory:///fleet/press_1/day_0"
    finally:
        memory.rm("/fleet", recursive=True)
    assert sorted(first.added()) == ALL
    assert [type(result) for result, _ in again.results] == [There] * len(ALL)
    (change,) = compared["press_1"].changes
    assert (change["what"], change["location"]) == ("arm_length", "joint_2")
    assert (change["after"], change["before"]) == ("day_1", "day_2")
    assert compared["press_2"].changes == ()


def test_a_bad_session_is_told_and_the_others_go_on(
    folder: Path, tmp_path: Path, client: distributed.Client
) -> None:
    mine = tmp_path / "fleet"
    shutil.copytree(folder / "press_1" / "day_0", mine / "a" / "good")
    shutil.copytree(mine / "a" / "good", mine / "a" / "same")
    shutil.copytree(mine / "a" / "good", mine / "b" / "bad")
    next((mine / "b" / "bad").glob("*.mcap")).write_bytes(b"no recording")
    with open_store(str(tmp_path / "h.sqlite"), make=True) as store:
        ledger, heard, again, tried = Ledger(store), Heard(), Heard(), Heard()
        run(client, machines(mine), ledger, ONCE, heard)
        assert len(heard.added()) == 1  # one of two with the same content
        (failure,) = heard.of(Failure)
        assert isinstance(failure, Failure)
        assert (failure.machine, failure.id) == ("b", "bad")
        assert str(mine / "b" / "bad") in failure.told
        run(client, machines(mine), ledger, ONCE, again)
        assert [r.failed for r in again.of(There) if isinstance(r, There)].count(True) == 1
        shutil.rmtree(mine / "b" / "bad")
        shutil.copytree(folder / "press_2" / "day_0", mine / "b" / "bad")
        run(client, machines(mine), ledger, ONCE, tried)
        assert tried.added() == ["b/bad"]
        assert ledger.failures() == ()


def test_what_was_changed_or_is_of_another_robot_is_no_result(
    folder: Path, tmp_path: Path, client: distributed.Client
) -> None:
    mine = tmp_path / "fleet"
    shutil.copytree(folder / "press_1" / "day_0", mine / "a" / "day")
    with open_store(str(tmp_path / "h.sqlite"), make=True) as store:
        ledger, changed, other = Ledger(store), Heard(), Heard()
        run(client, machines(mine), ledger, ONCE, Heard())
        (mine / "a" / "day" / "more.txt").write_text("x")
        run(client, machines(mine), ledger, ONCE, changed)
        run(client, machines_in(str(mine), robot_file("linear_delta")), ledger, ONCE, other)
        assert len(store.sessions("a")) == 1
    assert "machine 'a' has another session of this name" in str(changed.of(Failure)[0])
    assert "another robot, or its file was changed" in str(other.of(Failure)[0])


def test_the_machines_of_a_history_are_worked_through(
    folder: Path, tmp_path: Path, client: distributed.Client
) -> None:
    url = str(tmp_path / "h.sqlite")
    with open_store(url, make=True) as store:
        run(client, machines(folder)[:1], Ledger(store), ONCE, Heard())
        heard = Heard()
        run(client, machines_of(store), Ledger(store), QUICK, heard)
    assert len(heard.of(There)) == SESSIONS
    (compared,) = heard.of(Compared)
    assert isinstance(compared, Compared)
    assert len(compared.changes) == 1


def test_sessions_of_few_places_wait_for_the_others(
    folder: Path, robot: Robot, tmp_path: Path, client: distributed.Client
) -> None:
    """They are fitted with the information of the others, and reported if there are none."""
    mine = tmp_path / "fleet"
    plan = make_plan("identify", robot, count=6, seed=1)
    for name, seed in (("a", 0), ("b", 1)):
        machine = visited(draw_machine(robot, seed, 1.0), robot, seed, 9)
        for day in (5, 6):
            session = days_later(simulate_session(machine, plan, 40 + 10 * seed + day), day)
            write_session(mine / name / f"a_few_{day}", session, {})
    for day in range(2):
        shutil.copytree(folder / "press_1" / f"day_{day}", mine / "a" / f"day_{day}")
    with open_store(str(tmp_path / "h.sqlite"), make=True) as store:
        ledger, heard, again = Ledger(store), Heard(), Heard()
        run(client, machines(mine), ledger, QUICK, heard)
        updates = [entry.id for entry in store.sessions("a") if entry.is_update]
        done = ledger.done("a", quick=False)
        assert done == {e.sha256 for e in store.sessions("a") if e.is_update}
        run(client, machines(mine), ledger, QUICK, again)
    assert heard.added()[2:] == ["a/a_few_5", "a/a_few_6"]
    assert updates == ["a_few_5", "a_few_6"]
    assert [type(result) for result in heard.of(Compared)] == [Compared]
    assert len(again.of(There)) == 6
    told = [result.told for result in heard.of(Failure) if isinstance(result, Failure)]
    assert len(told) == 2
    assert all("no session in the history began before this one" in each for each in told)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder: folder.mkdir(), "contains no machine"),
        (lambda folder: (folder / "a" / "day").mkdir(parents=True), "'a' has no robot.yaml"),
        (lambda folder: None, "neither a folder of machines nor a history"),
    ],
)
def test_a_folder_without_machines_is_refused(
    make: object, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path / "fleet")  # type: ignore[operator]
    assert run_verb(["fleet", str(tmp_path / "fleet")]) == 2
    assert said in capsys.readouterr().err


def test_robots_of_machines_go_before_that_of_the_folder(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name / "day").mkdir(parents=True)
    shutil.copy(ROOT / "config" / "srbd.yaml", tmp_path / "robot.yaml")
    shutil.copy(ROOT / "config" / "linear_delta.yaml", tmp_path / "b" / "robot.yaml")
    found = {m.name: m.robot.document["name"] for m in machines_in(str(tmp_path), None)}
    assert found == {"a": "srbd", "b": "linear_delta"}


def test_a_file_system_that_there_is_not_is_told() -> None:
    with pytest.raises(InputError, match="cannot be read"):
        machines_in("memory://nothing_there", robot_file("srbd"))
