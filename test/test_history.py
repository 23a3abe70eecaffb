"""The history of a machine: changes between sessions, and the store of the sessions."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.data import Session, survey
from delta_calibration.effects import catalogue
from delta_calibration.errors import DataError, InputError
from delta_calibration.history import Change, Dated, History, find_changes, prospect
from delta_calibration.history.steps import known_before
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import days_later, draw_machine, simulate_session, visited

pytest.importorskip("sqlalchemy")

from delta_calibration.fleet.stored import known_machines
from delta_calibration.history.ledger import Ledger
from delta_calibration.history.store import open_store

BEGAN = datetime(2026, 1, 1, tzinfo=timezone.utc)
SEED = 3


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("srbd")


def measured(robot: Robot, day: int, causes: dict[str, dict[str, str]]) -> Session:
    """Simulate a session of one day, with tracker and reflector set up again."""
    machine = visited(draw_machine(robot, SEED, 1.0, causes), robot, SEED, day + 1)
    plan = make_plan("identify", robot, count=30, seed=1)
    return days_later(simulate_session(machine, plan, 100 + day), day)


def changes_of(robot: Robot, each: list[dict[str, dict[str, str]]]) -> History:
    days = [
        Dated(
            f"day_{day}",
            BEGAN + timedelta(days=day),
            survey(
                measured(robot, day, causes),
                robot.joints.names,
                robot.commanded.joint_size,
            ),
        )
        for day, causes in enumerate(each)
    ]
    return find_changes(days[::-1], robot)  # the order of the list does not matter


def test_a_tracker_set_up_anew_is_no_change(robot: Robot) -> None:
    found = changes_of(robot, [{}] * 5)
    assert found.changes == found.drift == ()
    assert found.sentences()[0].startswith("no change was found from day_0 to day_4")


def test_a_dimension_that_changed_is_told_with_its_gap_and_size(robot: Robot) -> None:
    longer = {"arm_length": {"location": "joint_3", "value": "1e-4"}}
    found = changes_of(robot, [{}, {}, longer, longer, longer])
    (change,) = found.changes
    assert (change.what, change.location) == ("arm_length", "joint_3")
    assert (change.after, change.before) == ("day_1", "day_2")
    assert abs(change.to - change.from_ - 1e-4) < 4 * change.std < 4e-5
    assert change.confidence > 0.9
    first, last = (BEGAN + timedelta(days=day) for day in (1, 2))
    assert change.when == (first, last)
    assert f"day_1 ({first:%Y-%m-%d}) and day_2 ({last:%Y-%m-%d})" in change.sentence()
    value, std = np.array(change.course).T
    level = np.where(np.arange(5) < 2, change.from_, change.to)
    assert (np.abs(value - level) < 4 * std).all()
    assert (std < 1e-4 / 4).all()  # each session alone can tell both values apart
    assert found.before.sum() > 2 * found.after.sum()


def test_two_changes_are_told_apart(robot: Robot) -> None:
    first = {"joint_zero_offset": {"location": "joint_1", "value": "3e-4"}}
    both = {**first, "joint_compliance": {"location": "joint_2", "value": "3e-5"}}
    found = changes_of(robot, [{}, first, first, both, both, both])
    assert [(c.what, c.location, c.after) for c in found.changes] == [
        ("joint_zero_offset", "joint_1", "day_0"),
        ("joint_compliance", "joint_2", "day_2"),
    ]


def test_a_diagnosis_of_the_same_readings_makes_a_change_no_surer(robot: Robot) -> None:
    """Whether the session after a change was diagnosed; `fit` of that session says the same."""
    play = {"backlash": {"location": "joint_2", "value": "5e-4"}}
    alone = [
        Dated(
            f"day_{day}",
            BEGAN + timedelta(days=day),
            survey(measured(robot, day, causes), robot.joints.names),
        )
        for day, causes in enumerate([{}, {}, play])
    ]
    (backlash,) = (e for e in catalogue(robot, robot.model()) if e.cause == "backlash")
    judged = [*alone[:2], replace(alone[2], effects=(backlash,))]
    (one,), (other,) = find_changes(alone, robot).changes, find_changes(judged, robot).changes
    assert (one.what, one.confidence, one.rivals) == (other.what, other.confidence, other.rivals)
    (by_fit,) = prospect(judged, robot, alone[2]).changes
    assert by_fit.confidence == pytest.approx(one.confidence, abs=0.005)
    assert by_fit.rivals == one.rivals


def test_a_cause_is_known_from_the_gap_after_its_diagnosis_on() -> None:
    found = known_before([["backlash"], [], ["joint_lag"], ["tracker_drift"]])
    assert found == ({"backlash"}, {"backlash"}, {"backlash", "joint_lag"})
    assert known_before([["backlash"]]) == ()


def test_sessions_of_one_day_are_told_with_their_time(robot: Robot) -> None:
    when = (BEGAN, BEGAN + timedelta(hours=3))
    change = Change("a", "b", "backlash", None, "gap", 0, 1, 0, 0, 1, "rad", 1, 1, (), 9, when, ())
    assert change.gap() == f"a ({when[0]:%Y-%m-%d %H:%M}) and b ({when[1]:%Y-%m-%d %H:%M})"


def test_one_session_has_no_changes(robot: Robot) -> None:
    with pytest.raises(DataError, match="1 session in the history; changes need 2"):
        changes_of(robot, [{}])


@pytest.fixture(scope="module")
def folder(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four days with an arm length that changes after the second one, and their store."""
    folder = tmp_path_factory.mktemp("history")
    for day in range(4):
        causes = {"arm_length": {"location": "joint_2", "value": "1e-4"}} if day > 1 else {}
        write_session(folder / f"day_{day}", measured(robot, day, causes), {})
        assert run([*add(folder, day), "--quick"]) == 0
    return folder


def add(folder: Path, day: int, machine: str = "press_3") -> list[str]:
    """Command-line arguments that add the session of a day."""
    return [
        "history",
        "add",
        str(folder / f"day_{day}"),
        "--robot",
        "srbd",
        "--machine",
        machine,
        "--store",
        str(folder / "h.sqlite"),
    ]


def test_changes_as_json_are_of_the_form_that_programs_read(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(folder / "h.sqlite")
    assert run(["history", "changes", "--machine", "press_3", "--store", store, "--json"]) == 0
    (change,) = json.loads(capsys.readouterr().out)
    assert list(change) == [
        "after",
        "before",
        "what",
        "location",
        "from",
        "to",
        "std",
        "unit",
        "confidence",
    ]
    assert (change["after"], change["before"]) == ("day_1", "day_2")
    assert (change["what"], change["location"], change["unit"]) == ("arm_length", "joint_2", "m")
    assert np.isclose(change["to"] - change["from"], 1e-4, atol=4 * change["std"])


def test_a_change_log_is_kept_for_the_page_of_a_fleet(folder: Path, tmp_path: Path) -> None:
    """Until the sessions are compared the page says so, and does not say that nothing changed."""
    store = shutil.copy(folder / "h.sqlite", tmp_path / "own.sqlite")
    with closing(sqlite3.connect(store)) as own:
        own.execute("DROP TABLE IF EXISTS fleet_changes")
        own.commit()
    with open_store(str(store)) as opened:
        (before,) = known_machines(Ledger(opened))
    assert (before.compared, before.changes) == (False, ())
    assert run(["history", "changes", "--machine", "press_3", "--store", str(store)]) == 0
    with open_store(str(store)) as opened:
        (after,) = known_machines(Ledger(opened))
    assert after.compared
    assert [(c["what"], c["after"], c["before"]) for c in after.changes] == [
        ("arm_length", "day_1", "day_2")
    ]


def test_a_report_and_lists_are_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store, page = ["--store", str(folder / "h.sqlite")], folder / "log.html"
    assert run(["history", "list", *store]) == 0
    assert run(["history", "list", "--machine", "press_3", *store]) == 0
    assert run(["history", "show", "day_1", "--machine", "press_3", *store]) == 0
    said = capsys.readouterr().out
    assert "press_3   srbd         4" in said
    assert "no causes looked for" in said
    pytest.importorskip("plotly")
    assert run(["history", "report", "--machine", "press_3", *store, "--out", str(page)]) == 0
    told = page.read_text(encoding="utf-8")
    assert "arm length of joint 2" in told
    assert "by this session" in told


def test_what_cannot_be_added_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(add(folder, 1)) == 2
    assert "is in the history of 'press_3' already, as session 'day_1'" in capsys.readouterr().err
    other = [arg if arg != "srbd" else "linear_delta" for arg in add(folder, 1)]
    assert run(other) == 2
    assert "another robot, or its file was changed" in capsys.readouterr().err
    nowhere = ["history", "list", "--store", str(tmp_path / "none.sqlite")]
    assert run(nowhere) == 2
    assert "no history found" in capsys.readouterr().err
    assert run(["history", "changes", "--machine", "x", "--store", str(folder / "h.sqlite")]) == 2
    assert "no machine 'x'; there are: press_3" in capsys.readouterr().err
    for name in ("", " ", "press_3 ", "press\n3"):
        assert run([*add(folder, 2, name), "--quick"]) == 2
        assert f"machine {name!r}: a name is expected" in capsys.readouterr().err


def test_a_diagnosis_that_was_made_is_kept_as_it_is(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only with the session that it was made from, and only verdict and calibration together."""
    verdict, calibration = tmp_path / "verdict.json", tmp_path / "extended.yaml"
    made = ["--json", str(verdict), "--out", str(calibration)]
    assert run(["diagnose", str(folder / "day_1"), "--robot", "srbd", *made]) == 0
    known = ["--verdict", str(verdict), "--calibration", str(calibration)]
    assert run([*add(folder, 1, "press_4"), *known]) == 0
    with open_store(str(folder / "h.sqlite")) as store:
        (entry,) = store.sessions("press_4")
    assert entry.verdict == json.loads(verdict.read_text())
    assert entry.calibration["provenance"]["method"] == "diagnosis"
    capsys.readouterr()
    for day, options, why in (
        (2, known, "was made from other poses"),
        (2, known[:2], "must be given together"),
        (2, [*known, "--quick"], "stores no verdict"),
        (2, [*known[:2], "--calibration", str(tmp_path / "none.yaml")], "none.yaml"),
    ):
        assert run([*add(folder, day, "press_4"), *options]) == 2
        assert why in capsys.readouterr().err
    with open_store(str(folder / "h.sqlite")) as store:
        assert len(store.sessions("press_4")) == 1


def test_a_bag_that_moved_or_changed_is_told(
    folder: Path, robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_session(tmp_path / "day_0", measured(robot, 0, {}), {})
    assert run([*add(tmp_path, 0), "--quick"]) == 0
    (tmp_path / "day_0").rename(tmp_path / "day_9")
    show = [
        "history",
        "show",
        "day_0",
        "--machine",
        "press_3",
        "--store",
        str(tmp_path / "h.sqlite"),
    ]
    assert run(show) == 2
    assert "is no longer at" in capsys.readouterr().err
    assert run(add(tmp_path, 9)) == 0  # the same recording at its new path
    assert run(show) == 0
    (tmp_path / "day_9" / "more.txt").write_text("x", encoding="utf-8")
    assert run(show) == 2
    assert "was changed since it was added" in capsys.readouterr().err


def test_a_database_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "h.sqlite").write_text("no database", encoding="utf-8")
    url = str(tmp_path / "h.sqlite")
    with pytest.raises(InputError, match="file is not a database"), open_store(url, make=True):
        pass
