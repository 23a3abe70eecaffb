"""Tests of the ledger of a fleet, on SQLite and on a real PostgreSQL."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from databases import server, url
from delta_calibration.cli.main import run as run_verb
from delta_calibration.errors import InputError
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import days_later, draw_machine, simulate_session, visited

pytest.importorskip("sqlalchemy")
pytest.importorskip("distributed")
pytest.importorskip("fsspec")

import distributed

from delta_calibration.fleet.places import machines_in, robot_file
from delta_calibration.fleet.run import Settings, run
from delta_calibration.fleet.stored import known_machines, never_measured
from delta_calibration.history.ledger import Compared, Failure, Ledger
from delta_calibration.history.store import Entry, open_store

__all__ = ["server", "url"]  # fixtures

BEGAN = datetime(2026, 1, 2, tzinfo=timezone.utc)
ROBOT, HASH = "srbd", "h" * 64
VERDICT = {"findings": [], "note": "null"}  # the word is not a missing verdict


def entry(number: int, **more: object) -> Entry:
    """A fitted session."""
    values = {
        "machine": "m",
        "id": f"day_{number}",
        "path": f"/bags/day_{number}",
        "sha256": f"hash {number}",
        "began": BEGAN + timedelta(days=number),
        "added": BEGAN,
        "topics": (),
        "calibration": {
            "noise": {"floor_mm": 0.01},
            "provenance": {"poses": 48},
            "residuals": {"full": {"error_left_rms_mm": 0.015}},
        },
        "verdict": None,
        **more,
    }
    return Entry(**values)


@pytest.mark.parametrize("verdict", [None, {**VERDICT, "extended": {"held_out_rms_mm": 0.02}}])
def test_the_error_that_is_told_is_that_of_a_fit(verdict: dict[str, object] | None) -> None:
    """The same for all sessions: a diagnosed one has the error of held-out sectors as well."""
    assert entry(0, verdict=verdict).error_left_mm == 0.015


def test_a_result_is_written_once(url: str) -> None:
    with open_store(url, make=True) as store:
        ledger = Ledger(store)
        assert ledger.keep(entry(0), ROBOT, HASH)
        assert not ledger.keep(entry(0), ROBOT, HASH)
        assert not ledger.keep(entry(0, id="the same elsewhere"), ROBOT, HASH)
        assert ledger.taken(entry(0, sha256="another"))
        assert not ledger.taken(entry(0))
        with pytest.raises(InputError):  # by the database, independent of programs
            store.add(entry(0, id="the same elsewhere"), ROBOT, HASH)
    with open_store(url) as store:
        assert [each.id for each in store.sessions("m")] == ["day_0"]
        assert Ledger(store).made_for() == {"m": (ROBOT, HASH)}


def test_a_fit_is_done_where_no_verdict_is_asked_and_an_update_in_any_case(url: str) -> None:
    told = {**entry(0).calibration, "provenance": {"poses": 12, "prior": "history"}}
    with open_store(url, make=True) as store:
        ledger = Ledger(store)
        for each in (entry(0), entry(1, verdict=VERDICT), entry(2, calibration=told)):
            ledger.keep(each, ROBOT, HASH)
        assert ledger.done("m", quick=True) == {"hash 0", "hash 1", "hash 2"}
        assert ledger.done("m", quick=False) == {"hash 1", "hash 2"}
        assert ledger.done("another", quick=True) == frozenset()
        assert ledger.keep(entry(0, verdict=VERDICT), ROBOT, HASH)  # diagnosed since
        assert not ledger.keep(entry(0), ROBOT, HASH)  # a fit does not replace it
        assert ledger.done("m", quick=False) == {"hash 0", "hash 1", "hash 2"}
        assert store.sessions("m")[0].verdict == VERDICT


def test_a_failure_is_told_until_there_is_a_result(url: str) -> None:
    failure = Failure("m", "day_0", "", "no \N{MICRO SIGN}m of it can be read")
    with open_store(url, make=True) as store:
        ledger = Ledger(store)
        ledger.fail(failure)
        ledger.fail(replace(failure, sha256="hash 0"))
        ledger.fail(Failure("n", "day_0", "", "gone"))
        assert ledger.failures()[0] == replace(failure, sha256="hash 0")
        assert set(never_measured(ledger)) == {"m", "n"}
        ledger.keep(entry(0), ROBOT, HASH)
        assert [each.machine for each in ledger.failures()] == ["n"]
        (machine,) = known_machines(ledger)
        assert (machine.machine, machine.sessions[0].noise_mm) == ("m", 0.01)


def test_the_last_comparison_is_kept(url: str) -> None:
    change = {"what": "backlash", "location": "joint_2", "signal": 1e3, "from": 1e-4}
    with open_store(url, make=True) as store:
        ledger = Ledger(store)
        ledger.keep_compared(Compared("m", "a", (), "it could not be"))
        ledger.keep_compared(Compared("m", "b", (change,)))
        ledger.keep_compared(Compared("n", "c", ()))
    with open_store(url) as store:
        found = Ledger(store).compared()
        assert found["m"] == Compared("m", "b", (change,))
        assert Ledger(store).compared("n") == {"n": Compared("n", "c", ())}


def test_a_fleet_is_worked_through_into_either_database(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second run does nothing; the page is made from the ledger."""
    robot = load_robot("srbd")
    for day in range(2):
        machine = visited(draw_machine(robot, 3, 1.0), robot, 3, day + 1)
        plan = make_plan("identify", robot, count=16, seed=1)
        recorded = days_later(simulate_session(machine, plan, 50 + day), day)
        write_session(tmp_path / "fleet" / "press" / f"day_{day}", recorded, {})
    machines = machines_in(str(tmp_path / "fleet"), robot_file("srbd"))
    told: list[tuple[str, bool]] = []
    with (
        open_store(url, make=True) as store,
        distributed.Client(
            processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        ) as client,
    ):
        for _ in range(2):
            run(
                client,
                machines,
                Ledger(store),
                Settings(quick=True),
                lambda result, new: told.append((type(result).__name__, new)),
            )
    assert told == [("Entry", True)] * 2 + [("Compared", True)] + [("There", False)] * 2
    pytest.importorskip("plotly")
    page = tmp_path / "fleet.html"
    report = ["fleet", "report", "--store", url, "--on", "2026-01-10", "--out", str(page)]
    assert run_verb(report) == 0
    assert "press" in page.read_text(encoding="utf-8")
