"""Sessions of few poses in the history are kept, compared with the others and counted once."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.data import Session, survey
from delta_calibration.effects import catalogue
from delta_calibration.errors import DataError
from delta_calibration.fleet.evidence import fitted
from delta_calibration.history import Dated, find_changes, prospect
from delta_calibration.history.few import is_few, pool
from delta_calibration.plans import Plan, make_plan
from delta_calibration.plans.renewal import renewal_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import days_later, draw_machine, simulate_session, visited

BEGAN = datetime(2026, 1, 1, tzinfo=timezone.utc)
SEED = 5
LONGER = {"arm_length": {"location": "joint_3", "value": "1.5e-4"}}
Causes = dict[str, dict[str, str]]


def measured(robot: Robot, day: int, plan: Plan, causes: Causes, seed: int = SEED) -> Session:
    """Simulate a session of one day, with tracker and reflector set up again."""
    machine = visited(draw_machine(robot, seed, 1.0, causes), robot, seed, day + 1)
    return days_later(simulate_session(machine, plan, 100 + day), day)


def dated(robot: Robot, day: int, plan: Plan, causes: Causes, seed: int = SEED) -> Dated:
    recorded = measured(robot, day, plan, causes, seed)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    return Dated(f"day_{day}", BEGAN + timedelta(days=day), seen)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("srbd")


@pytest.fixture(scope="module")
def whole(robot: Robot) -> Plan:
    return make_plan("identify", robot, count=30, seed=1)


@pytest.fixture(scope="module")
def old(robot: Robot, whole: Plan) -> list[Dated]:
    return [dated(robot, day, whole, {}) for day in range(2)]


@pytest.fixture(scope="module")
def few(robot: Robot, old: list[Dated]) -> Plan:
    return renewal_plan(robot, prospect(old, robot).carried, 6, seed=1).plan


def test_changes_are_found_among_sessions_of_few_places(
    robot: Robot, old: list[Dated], few: Plan
) -> None:
    """A change between two such sessions is found as well, and none where nothing changed."""
    days = [dated(robot, day, few, {}) for day in range(2, 5)]
    assert all(is_few(day.survey) for day in days)
    assert find_changes([*old, *days], robot).changes == ()
    later = [dated(robot, day, few, LONGER) for day in range(5, 8)]
    found = find_changes([*later, *old, *days], robot)  # the order of the list does not matter
    (change,) = found.changes
    assert (change.what, change.location) == ("arm_length", "joint_3")
    assert (change.after, change.before) == ("day_4", "day_5")
    assert abs(change.to - change.from_ - 1.5e-4) < 4 * change.std < 1e-4
    assert found.sessions == tuple(f"day_{day}" for day in range(8))


def test_a_session_of_few_places_says_what_its_own_readings_say(
    robot: Robot, old: list[Dated], few: Plan
) -> None:
    """Its information does not depend on the other sessions, so nothing is counted twice."""
    day = dated(robot, 2, few, {})
    by_one, by_more = (pool([*each, day], robot).said[-1] for each in (old[:1], old))
    assert by_one.name == by_more.name == "day_2"
    told = [float(np.trace(said.information)) for said in (by_one, by_more)]
    assert abs(told[0] / told[1] - 1) < 0.1
    assert max(told) < np.trace(pool(old, robot).said[0].information)


def test_what_few_places_say_is_carried_on(robot: Robot, old: list[Dated], few: Plan) -> None:
    """The carried state follows a change that only sessions of few poses have seen."""
    days = [dated(robot, day, few, LONGER) for day in range(2, 6)]
    arm = robot.model().parameters.names.index("arm_3")
    seen, unseen = (prospect(each, robot).carried for each in ([*old, *days], old))
    true = draw_machine(robot, SEED, 1.0, LONGER).theta[arm]
    spread = float(np.sqrt(seen.covariance[arm, arm]))
    assert abs(seen.mean[arm] - true) < 4 * spread < 4e-4
    assert abs(unseen.mean[arm] - true) > 1e-4
    assert seen.sessions == ("day_0", "day_1", "day_2", "day_3", "day_4", "day_5")


@pytest.mark.parametrize("seed", [5, 7, 8])
def test_few_places_of_an_unchanged_machine_do_not_contradict_its_history(
    robot: Robot, seed: int
) -> None:
    """Backlash biases the fits of the whole sessions here, and together they are very certain."""
    plan = make_plan("identify", robot, count=24, seed=1)
    (effect,) = (e for e in catalogue(robot, robot.model()) if e.cause == "backlash")
    plays = [{"backlash": {"location": "joint_2", "value": v}} for v in ("1.2e-4", "3.1e-4")]
    days = [
        replace(dated(robot, day, plan, plays[day > 4], seed), effects=(effect,))
        for day in range(12)
    ]
    few = renewal_plan(robot, prospect(days, robot).carried, 6, seed=1).plan
    expected = prospect(days, robot, dated(robot, 12, few, plays[1], seed))
    assert [change.what for change in expected.changes] == ["backlash"]
    assert expected.odd == 1.0


def test_few_places_before_any_whole_session_count_as_well(
    robot: Robot, old: list[Dated], few: Plan
) -> None:
    first = Dated("first", BEGAN - timedelta(days=3), dated(robot, 2, few, {}).survey)
    assert [said.name for said in pool([first, *old], robot).said] == ["first", "day_0", "day_1"]
    assert find_changes([first, *old], robot).changes == ()
    with pytest.raises(DataError, match="no session has 12 or more places"):
        pool([first, first], robot)


@pytest.fixture(scope="module")
def folder(robot: Robot, whole: Plan, few: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of two whole days and of two sessions of few poses, after an arm has grown."""
    folder = tmp_path_factory.mktemp("few")
    for day in range(4):
        plan, causes = (few, LONGER) if day > 1 else (whole, {})
        write_session(folder / f"day_{day}", measured(robot, day, plan, causes), {})
    return folder


def add(folder: Path, days: list[int], *more: str) -> list[str]:
    store = ["--machine", "m", "--store", str(folder / "h.sqlite"), "--robot", "srbd"]
    return ["history", "add", *(str(folder / f"day_{day}") for day in days), *store, *more]


def test_few_places_are_added_by_the_verb(
    folder: Path,
    robot: Robot,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("sqlalchemy")
    from delta_calibration.history import adding
    from delta_calibration.history.store import Entry, open_store

    store = ["--machine", "m", "--store", str(folder / "h.sqlite")]
    assert run(add(folder, [2])) == 1
    assert (
        "first session of a machine needs at least 12 different poses at rest, but this one has 6"
        in (capsys.readouterr().err)
    )
    assert run(add(folder, [0, 1], "--quick")) == 0
    capsys.readouterr()
    read: list[str] = []

    def read_again(entry: Entry, robot: Robot) -> Dated:
        read.append(entry.id)
        return reading(entry, robot)

    reading = adding.read_again
    monkeypatch.setattr(adding, "read_again", read_again)
    assert run(add(folder, [2, 3])) == 0
    assert read == ["day_0", "day_1", "day_2"]  # each recording is read once
    said = capsys.readouterr().out
    assert "carried over from 2 sessions (day_0 to day_1)" in said
    assert "changed: between day_1 (2023-11-15) and day_2 (2023-11-16) the arm length" in said
    assert "carried over from 3 sessions (day_0 to day_2)" in said
    assert run(add(folder, [3])) == 2
    assert "is in the history of 'm' already" in capsys.readouterr().err
    with open_store(str(folder / "h.sqlite")) as opened:
        entries = opened.sessions("m")
    assert [entry.is_update for entry in entries] == [False, False, True, True]
    # the priors of a fleet use only fits that did not use the history
    assert len(fitted("m", (entry.calibration for entry in entries), robot).calibrations) == 2
    assert run(["history", "changes", *store]) == 0
    assert "and day_2 (2023-11-16) the arm length of joint 3" in capsys.readouterr().out
    assert run(["history", "list", *store]) == 0
    assert "update: fitted with the results of the history" in capsys.readouterr().out


def test_a_whole_session_may_be_an_update_too(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A session added with `--update` cannot be added with a verdict of its own."""
    pytest.importorskip("sqlalchemy")
    for day in range(2):
        (tmp_path / f"day_{day}").symlink_to(folder / f"day_{day}")
    assert run(add(tmp_path, [0], "--quick")) == 0
    assert run(add(tmp_path, [1], "--update")) == 0
    assert "carried over from 1 session (day_0 to day_0)" in capsys.readouterr().out
    known = ["--verdict", "v.json", "--calibration", "c.yaml"]
    assert run(add(folder, [2], "--update", *known)) == 2
    assert "--update: fits with the history" in capsys.readouterr().err
