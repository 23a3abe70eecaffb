"""The store on SQLite and PostgreSQL, upgrades of old stores, recordings on other file systems."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path

import pytest

from databases import server, url
from delta_calibration.cli.main import run
from delta_calibration.errors import InputError
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

pytest.importorskip("sqlalchemy")
pytest.importorskip("fsspec")

import fsspec
import sqlalchemy

from delta_calibration.history import store as history_store
from delta_calibration.history.bags import at_hand, bag_hash, is_there, name_of
from delta_calibration.history.store import BY_COMMAND, BY_NODE, Entry, open_store

__all__ = ["server", "url"]  # fixtures

BEGAN = datetime(2026, 1, 2, 3, 4, tzinfo=timezone.utc)
FIRST = (  # schema of version 1
    "CREATE TABLE delta_cal_history (version INTEGER NOT NULL)",
    "INSERT INTO delta_cal_history VALUES (1)",
    "CREATE TABLE machines (name VARCHAR(255) NOT NULL PRIMARY KEY, robot VARCHAR NOT NULL, "
    "robot_sha256 VARCHAR(64) NOT NULL)",
    "CREATE TABLE sessions (machine VARCHAR(255) NOT NULL REFERENCES machines (name), "
    "id VARCHAR(255) NOT NULL, path VARCHAR NOT NULL, sha256 VARCHAR(64) NOT NULL, "
    "began VARCHAR(40) NOT NULL, added VARCHAR(40) NOT NULL, topics JSON NOT NULL, "
    "calibration JSON NOT NULL, verdict JSON, PRIMARY KEY (machine, id))",
    "INSERT INTO machines VALUES ('m', 'srbd', 'abc')",
    "INSERT INTO sessions VALUES ('m', 'day_0', '/bags/day_0', 'def', "
    "'2026-01-02T03:04:00+00:00', '2026-01-02T03:04:00+00:00', '[]', '{\"model\": \"x\"}', NULL)",
)


def engine_of(url: str) -> object:
    if "://" not in url:
        return sqlalchemy.create_engine(f"sqlite:///{url}")
    return sqlalchemy.create_engine(url.replace("postgresql://", "postgresql+psycopg://"))


def entry(name: str = "day_1", **more: object) -> Entry:
    values = {
        "machine": "m",
        "id": name,
        "path": f"/bags/{name}",
        "sha256": f"hash of {name}",
        "began": BEGAN,
        "added": BEGAN,
        "topics": ("command=/mine",),
        "calibration": {"model": "delta", "list": [1.5, None, "µ"]},
        "verdict": {"findings": []},
        **more,
    }
    return Entry(**values)


def test_what_is_added_comes_back_the_same(url: str) -> None:
    with open_store(url, make=True) as store:
        store.add(
            entry("day_2", began=BEGAN.replace(day=5), verdict=None, added_by=BY_NODE), "r", "h"
        )
        store.add(entry(), "r", "h")
    with open_store(url) as store:
        assert store.machines() == (("m", "r"),)
        first, second = store.sessions("m")
        assert first == entry()
        assert (second.id, second.verdict, second.added_by) == ("day_2", None, BY_NODE)
        store.moved("m", "hash of day_1", "/elsewhere")
        assert store.sessions("m")[0].path == "/elsewhere"


def test_the_same_id_twice_is_refused_by_the_database_as_well(url: str) -> None:
    """This happens when two programs add the session at the same time."""
    with open_store(url, make=True) as store:
        store.add(entry(), "r", "h")
        with pytest.raises(InputError):
            store.add(entry(), "r", "h")
        assert len(store.sessions("m")) == 1


def test_a_store_of_the_first_version_is_brought_up(url: str) -> None:
    engine = engine_of(url)
    with engine.begin() as connection:
        for line in FIRST:
            connection.exec_driver_sql(line)
    engine.dispose()
    for _ in range(2):  # the second time there is nothing to upgrade
        with open_store(url) as store:
            (old,) = store.sessions("m")
            assert (old.id, old.added_by, old.calibration) == ("day_0", BY_COMMAND, {"model": "x"})
    with open_store(url) as store:
        store.add(entry(added_by=BY_NODE), "srbd", "abc")
        assert [e.added_by for e in store.sessions("m")] == [BY_COMMAND, BY_NODE]


def test_an_upgrade_that_fails_leaves_the_old_version(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_store(url, make=True) as store:
        store.add(entry(), "r", "h")

    def fails(connection: object) -> None:
        connection.exec_driver_sql("UPDATE machines SET robot = 'lost'")
        connection.exec_driver_sql("ALTER TABLE nowhere ADD COLUMN x INTEGER")

    now = history_store.VERSION
    monkeypatch.setattr(history_store, "VERSION", now + 1)
    monkeypatch.setattr(history_store, "UPGRADES", {now: fails})
    with pytest.raises(InputError, match="nowhere"), open_store(url):
        pass
    monkeypatch.undo()
    with open_store(url) as store:
        assert store.machines() == (("m", "r"),)


def test_a_newer_store_is_refused(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_store(url, make=True):
        pass
    now = history_store.VERSION
    monkeypatch.setattr(history_store, "VERSION", now - 1)
    newer = f"a history of version {now}, but this program supports {now - 1}"
    with pytest.raises(InputError, match=newer), open_store(url):
        pass


def test_a_database_that_cannot_be_reached_is_told_without_its_password(tmp_path: Path) -> None:
    pytest.importorskip("psycopg")
    url = f"postgresql://someone:secret@/history?host={tmp_path}"
    with pytest.raises(InputError) as caught, open_store(url):
        pass
    assert "secret" not in str(caught.value)
    assert "someone" in str(caught.value)
    with pytest.raises(InputError, match="cannot be opened"), open_store("nonsense://x"):
        pass


def test_a_password_is_not_told_where_all_goes_well(
    request: pytest.FixtureRequest, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither by `add` and `fleet report`, nor if the session or the machine does not exist."""
    folder = request.getfixturevalue("server")
    url = f"postgresql://postgres:secret@/postgres?host={folder}"
    store = ["--machine", "m", "--store", url]
    assert run(["history", "add", str(bag), "--robot", "srbd", "--quick", *store]) == 0
    assert run(["history", "show", "none", *store]) == 2
    assert run(["history", "changes", "--machine", "none", "--store", url]) == 2
    assert run(["fleet", "report", "--store", url, "--out", str(folder / "p.html")]) == 0
    assert "secret" not in "".join(capsys.readouterr())


def test_a_missing_driver_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(InputError, match="needs psycopg"), open_store("postgresql://x@y/z"):
        pass


# Recordings


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot = load_robot("srbd")
    path = tmp_path_factory.mktemp("bags") / "day_0"
    plan = make_plan("identify", robot, count=14, dwell=0.4, seed=1)
    write_session(path, simulate_session(draw_machine(robot, 2), plan, 2), {})
    (path / "notes").mkdir()
    (path / "notes" / "a.txt").write_text("x", encoding="utf-8")
    return path


@pytest.fixture(params=["memory", "zip"])
def elsewhere(request: pytest.FixtureRequest, bag: Path, tmp_path: Path) -> Iterator[str]:
    """URL of the same recording on another file system."""
    if request.param == "zip":
        file = tmp_path / "days.zip"
        with zipfile.ZipFile(file, "w") as archive:
            for path in sorted(bag.rglob("*")):
                archive.write(path, f"week/day_0/{path.relative_to(bag)}")
        yield f"zip://week/day_0::{file}"
        return
    memory = fsspec.filesystem("memory")
    memory.put(str(bag), "/bags/day_0", recursive=True)
    yield "memory://bags/day_0"
    memory.rm("/bags", recursive=True)


def test_a_bag_is_the_same_on_any_file_system(bag: Path, elsewhere: str) -> None:
    assert is_there(elsewhere)
    assert name_of(elsewhere) == "day_0"
    assert bag_hash(elsewhere) == bag_hash(str(bag))
    with at_hand(elsewhere) as folder:
        assert folder.name == "day_0"
        assert bag_hash(str(folder)) == bag_hash(str(bag))
    assert not folder.exists()
    assert not is_there(elsewhere.replace("day_0", "day_7"))


def test_a_bag_elsewhere_is_added_and_its_change_is_told(
    elsewhere: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = ["--machine", "m", "--store", str(tmp_path / "h.sqlite")]
    add = ["history", "add", elsewhere, "--robot", "srbd", "--quick", *store]
    assert run(add) == 0
    assert run(["history", "show", "day_0", *store]) == 0
    assert elsewhere in capsys.readouterr().out
    assert run(add) == 2
    assert "already" in capsys.readouterr().err
    if elsewhere.startswith("memory"):
        with fsspec.open(elsewhere + "/more.txt", "w") as file:
            file.write("x")
        assert run(["history", "show", "day_0", *store]) == 2
        assert "was changed since it was added" in capsys.readouterr().err


def test_a_place_that_cannot_be_reached_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        is_there("nosuchprotocol://x/y")
    with pytest.raises(InputError, match="cannot be read"):
        bag_hash(f"zip://day::{tmp_path}/none.zip")


def test_a_url_without_its_library_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(InputError, match="a URL needs fsspec"):
        is_there("memory://x")
