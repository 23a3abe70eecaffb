"""Arithmetic of the study: rates, calibration of probabilities, tables."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from study.judge import true_value
from study.page import page
from study.rivals import compared, judged
from study.statistics import Rate, calibration_error
from study.trials import OF_ROBOT, ROBOTS, Task, tasks

COMMAND = "make study"


@pytest.mark.parametrize(
    ("hidden", "named"), [((("tracker_drift", 600.0),), ["tracker_drift"]), ((), [])]
)
def test_a_search_by_bic_names_a_strong_cause_and_none_without(hidden, named):
    task = Task("single", 8800, hidden)
    assert [one["cause"] for one in judged(task.key)["bic"]] == named


def test_names_are_compared_by_what_was_hidden():
    told = [{"cause": "backlash", "confidence": 0.9}, {"cause": "joint_lag", "confidence": 0.6}]
    sessions = [
        {"group": "single", "hidden": {"backlash": 100.0}},
        {"group": "single", "hidden": {"joint_lag": 50.0}},
        {"group": "none", "hidden": {}},
    ]
    rows = {row[0]: row[1] for row in compared([(one, told) for one in sessions])}
    of = {name: (rate.held, rate.of) for name, rate in rows.items()}
    assert of["one cause, name right in the first place, lambda >= 80"] == (1, 1)
    assert of["one cause, this name and no other, lambda >= 80"] == (0, 1)
    assert of["one or two causes, a wrong name 80% sure"] == (1, 2)
    assert of["clean machines, a name"] == (1, 1)


def test_no_alarm_in_500_leaves_up_to_three_quarters_of_a_percent():
    """Zero of n: the upper limit solves (1 - p)^n = 0.025."""
    low, high = Rate(0, 500).interval
    assert low == 0
    assert high == pytest.approx(1 - 0.025 ** (1 / 500))


def test_interval_of_a_rate_is_the_tabulated_one():
    """Clopper and Pearson (1934), 95 %: the interval of 3 of 10 is 0.067 to 0.652."""
    assert Rate(3, 10).interval == pytest.approx((0.0667, 0.6525), abs=1e-4)


def test_calibration_error_is_nought_for_the_honest_and_large_for_the_boastful():
    rng = np.random.default_rng(1)
    stated = rng.uniform(0.3, 1.0, 20_000)
    honest = rng.random(20_000) < stated
    assert calibration_error(stated, honest) < 0.01
    boastful = rng.random(20_000) < stated - 0.2
    assert calibration_error(stated, boastful) == pytest.approx(0.2, abs=0.01)


def test_trials_are_the_same_for_the_same_seed_and_each_its_own_machine():
    some = tasks(1, 0.05)
    assert some == tasks(1, 0.05)
    assert some != tasks(2, 0.05)
    assert len({task.seed for task in some}) == len(some)
    assert [Task.of_key(task.key) for task in some] == some


def test_a_whole_study_has_500_clean_machines_and_every_cause():
    every = tasks(1, 1.0)
    assert sum(task.group == "none" for task in every) == 500
    hidden = {cause for task in every for cause, _ in task.causes}
    assert len([name for name in hidden if name.startswith("unknown:")]) == 7
    assert len(hidden) == 7 + 22


def test_other_robots_have_trials_of_their_own_and_the_delta_keeps_its():
    both = tasks(1, 0.05, ("srbd", "scara"))
    assert both[: -len(tasks(1, 0.05, ("scara",)))] == tasks(1, 0.05)
    assert "robot" not in json.loads(both[0].key)
    assert [Task.of_key(task.key) for task in both] == both
    for robot in ROBOTS[1:]:
        own = tasks(1, 0.05, (robot,))
        hidden = {cause for task in own for cause, _ in task.causes}
        assert {task.robot for task in own} == {robot}
        assert {*OF_ROBOT[robot][0], *OF_ROBOT[robot][1]} <= hidden


def outcome(group: str, hidden: dict, findings: list, unknown: bool = False, **more) -> dict:
    return {
        "key": json.dumps({"causes": [[name, 0] for name in hidden]}),
        "group": group,
        "plan": "rich",
        "seed": 1,
        "hidden": hidden,
        "location": dict.fromkeys(hidden),
        "findings": findings,
        "unknown": unknown,
        "cannot_tell": [],
        "intervals": [],
        "seconds": 1.0,
        "noise_um": 9.0,
        "error_um": {"calibrated": 2.0, "extended": 1.0, "oracle": 1.0},
        **more,
    }


def finding(cause: str, *equivalents: str, confidence: float = 0.9) -> dict:
    return {
        "cause": cause,
        "location": None,
        "equivalents": list(equivalents),
        "confidence": confidence,
        "signal": 100.0,
    }


def row_of(text: str, begin: str) -> list[str]:
    line = next(line for line in text.splitlines() if line.startswith(f"| {begin} "))
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_the_page_counts_what_was_said():
    outcomes = [
        outcome("none", {}, []),
        outcome("none", {}, [finding("backlash")]),
        outcome("single", {"backlash": 200.0}, [finding("backlash")]),
        outcome("single", {"backlash": 200.0}, [finding("stick_slip", "backlash")]),
        outcome("single", {"backlash": 100.0}, [finding("joint_lag")]),
        outcome("single", {"backlash": 90.0}, []),
        outcome("pair", {"backlash": 200.0, "joint_lag": 300.0}, [finding("backlash")]),
        outcome("unknown", {"unknown": 200.0}, [], unknown=True),
        outcome("unknown", {"unknown": 200.0}, [finding("backlash", confidence=0.4)], True),
    ]
    text = page(outcomes, len(outcomes), COMMAND)
    assert "Alarms: 50.0% (1.3% to 98.7%, n = 2). By name: backlash 1." in text
    _, seen, in_class, named, wrong = row_of(text, ">= 80")
    assert (seen[:5], in_class[:5], named[:5], wrong[:5]) == ("75.0%", "50.0%", "25.0%", "25.0%")
    assert row_of(text, ">= 160")[2].startswith("100.0%")
    assert row_of(text, "backlash + joint_lag") == ["backlash + joint_lag", "backlash"]
    assert "nothing named with 50% confidence or more 100.0%" in text
    assert "nothing named at all 50.0%" in text


def test_the_page_has_a_row_for_each_robot():
    named = [finding("backlash")]
    outcomes = [
        outcome("single", {"backlash": 200.0}, named, robot="scara", processor=4.0),
        outcome("single", {"backlash": 100.0}, [], robot="scara", processor=12.0),
        outcome("none", {}, [], robot="ur10", processor=30.0),
        outcome("unknown", {"unknown": 200.0}, [], unknown=True, robot="ur10", processor=8.0),
    ]
    text = page(outcomes, len(outcomes), COMMAND)
    scara, ur10 = row_of(text, "scara"), row_of(text, "ur10")
    assert [cell[:6] for cell in scara[1:6]] == ["2", "50.0% ", "100.0%", "50.0% ", "100.0%"]
    assert scara[-1] == "8.0, 11.6, 12.0"
    assert ur10[7].startswith("0.0%")
    assert ur10[8].startswith("100.0%")
    assert "By mechanism" not in page([outcome("none", {}, [])], 1, COMMAND)


def test_the_page_tells_what_an_extension_is_worth():
    better = {"calibrated": 2.0, "extended": 1.2, "oracle": 1.0}
    worse = {"calibrated": 2.0, "extended": 2.2, "oracle": 1.0}
    outcomes = [
        outcome("single", {"backlash": 200.0}, [finding("backlash")], error_um=error)
        for error in (better, worse)
    ]
    quiet = page([{**o, "noise_um": 1.5} for o in outcomes], len(outcomes), COMMAND)
    assert "of a pose (about 1 um) 50.0%" in quiet
    text = page(outcomes, len(outcomes), COMMAND)
    share = ((1 - 0.36) + (1 - 1.21)) / (2 * 0.75)
    assert f"take away {share:.1%} of the mean square error" in text
    assert "of a pose (about 1 um) 0.0%" in text
    assert "by more than 0.1 um 50.0%" in text


def test_a_finding_is_held_against_the_hidden_value_of_its_own_leg():
    """The level of a friction is separate; it is not part of a backlash beside it."""
    friction = {"friction_1": 20e-6, "play_1": 8e-6}
    values = {"backlash": {"gap_1": 9e-6, "gap_2": 5e-6}, "stick_slip": friction}
    both = SimpleNamespace(hidden=SimpleNamespace(values=values))
    assert true_value(both, "backlash", "gap", "_1") == pytest.approx(9e-6)
    assert true_value(both, "backlash", "gap", "_2") == pytest.approx(5e-6)
    assert true_value(both, "backlash", "gap", "_3") is None


def test_the_page_counts_true_values_within_stated_intervals():
    items = [
        {"of": "backlash.gap_1", "true": 0.0, "value": value, "std": 1.0} for value in (1.9, 2.1)
    ]
    text = page([outcome("single", {"backlash": 200.0}, [], intervals=items)], 1, COMMAND)
    assert "hold the true value: 50.0%" in text


def test_a_study_that_was_cut_off_goes_on_where_it_was(tmp_path):
    """Of two trials one is in the file, and half a line of the other. Uses real Dask workers."""
    pytest.importorskip("distributed", reason="needs the extra [study]")
    wanted = [task for task in tasks(3, 0.004) if task.group == "none"]
    assert len(wanted) == 2
    known = outcome("none", {}, [], seconds=123.0) | {"key": wanted[0].key}
    out, document = tmp_path / "study.jsonl", tmp_path / "study.md"
    out.write_text(json.dumps(known) + '\n{"key": "cut o')
    root = Path(__file__).resolve().parents[1]
    command = [sys.executable, "-m", "study", "--seed", "3", "--share", "0.004", "--only", "none"]
    command += ["--workers", "1", "--out", str(out), "--page", str(document)]
    path = os.pathsep.join([str(root / "test"), str(root / "benchmarks")])
    around = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, env=around, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    assert {line["key"] for line in lines} == {task.key for task in wanted}
    assert len(lines) == 2
    assert lines[0]["seconds"] == 123.0
    assert "n = 2" in document.read_text()
