"""Tests of the states of a fleet's machines, their shared causes, and the page."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from delta_calibration.fleet.shared import Shared, chance_of, shared_causes
from delta_calibration.fleet.standing import (
    CAUSE,
    DRIFTED,
    FINE,
    STALE,
    UNKNOWN,
    Known,
    Measured,
    Standing,
    first_visits,
    standing,
)
from delta_calibration.report.fleet import page_of_fleet

DAY = datetime(2026, 6, 1, tzinfo=timezone.utc)
LATELY = timedelta(days=90)
CAUSES, PLACES = 22, 3  # for which a diagnosis searches


def verdict(
    *causes: tuple[str, str | None], left: float = 0.015, **shape: float
) -> dict[str, Any]:
    """A verdict with these causes; each contributes 0.04 mm in addition to the residual."""
    findings = [
        {
            "cause": cause,
            "location": where,
            "kind": "geometry" if cause == "arm_length" else "drive",
            "shape": shape,
            "action": {"do": "repair", "part": f"gear of {where}"},
        }
        for cause, where in causes
    ]
    calibrated = float(np.hypot(left, 0.04)) if causes else left
    return {
        "findings": findings,
        "calibrated": {"held_out_rms_mm": calibrated},
        "extended": {"held_out_rms_mm": left},
        "unknown_structure": {"found": False, "moves_with": None, "rms_mm": None},
    }


def known(name: str, last: dict[str, Any] | None, ago: float = 10.0, **more: Any) -> Known:
    """A machine with two sessions, the last of them `ago` days old."""
    sessions = tuple(
        Measured(f"s{k}", DAY - timedelta(days=ago + 30 * (1 - k)), last, 0.015, 0.01, 48)
        for k in range(2)
    )
    return Known(name, "srbd", sessions, **more)


def stands(*arguments: Any, **more: Any) -> Standing:
    return standing(known(*arguments, **more), DAY, LATELY)


CHANGE = {"what": "backlash", "location": "joint_2", "after": "s0", "before": "s1", "signal": 5e3}


def test_a_machine_has_the_first_state_that_is_true_of_it() -> None:
    unknown = verdict()
    unknown["unknown_structure"] = {"found": True, "moves_with": "time", "rms_mm": 0.02}
    backlash = verdict(("backlash", "joint_1"))
    assert stands("a", verdict()).state == FINE
    assert stands("a", verdict(("arm_length", "joint_1"))).state == FINE  # removed by calibration
    assert stands("a", backlash).state == CAUSE
    assert stands("a", verdict(), ago=100).state == STALE
    assert stands("a", backlash, changes=(CHANGE,)).state == DRIFTED
    assert stands("a", verdict(), ago=100, changes=(CHANGE,)).state == STALE  # long ago
    assert stands("a", unknown).state == UNKNOWN
    assert stands("a", None).state == UNKNOWN


def test_what_else_is_true_of_a_machine_follows_its_state() -> None:
    backlash = verdict(("backlash", "joint_1"))
    old = stands("a", backlash, ago=100, changes=(CHANGE,), compared=False)
    assert old.state == CAUSE
    assert old.why == (
        "backlash at joint 1; also: last measured 100 days ago; not lately: backlash at joint 2 "
        "changed between s0 and s1; its sessions were not compared, so no change is known"
    )
    both = stands("a", backlash, changes=(CHANGE,))
    assert both.why == ("backlash at joint 2 changed between s0 and s1; also: backlash at joint 1")
    assert stands("a", backlash).why == "backlash at joint 1"
    assert "not compared" in stands("a", verdict(), compared=False).why


def test_an_update_leaves_the_verdict_before_it_and_counts_as_measured() -> None:
    before = known("a", verdict(("backlash", "joint_1")), ago=100)
    update = Measured("new", DAY - timedelta(days=2), None, 0.012, 0.01, 12, is_update=True)
    now = standing(Known("a", "srbd", (*before.sessions, update)), DAY, LATELY)
    assert (now.state, now.error_left_mm, now.last) == (CAUSE, 0.012, update.began)
    assert now.stake_mm == pytest.approx(0.04)
    fine = known("a", verdict(), ago=100)
    assert standing(Known("a", "srbd", (*fine.sessions, update)), DAY, LATELY).state == FINE


def test_what_is_at_stake_says_what_to_visit_first() -> None:
    cause = stands("cause", verdict(("backlash", "joint_1")))
    assert cause.stake_mm == pytest.approx(0.04)
    drift = stands("drift", verdict(), changes=(CHANGE,))
    # Lambda is the sum of (displacement / noise of a coordinate)^2 over three coordinates of 48
    # poses.
    assert drift.stake_mm == pytest.approx(0.01 * np.sqrt(5e3 / (3 * 48)))
    old, older = stands("old", verdict(), ago=100), stands("older", verdict(), ago=200)
    fine = stands("fine", verdict())
    order = [each.machine for each in first_visits([fine, old, cause, older, drift])]
    assert order == ["drift", "cause", "older", "old"]


def fleet(rng: np.random.Generator, rates: np.ndarray, batch: int = 0) -> list[Standing]:
    """200 machines with random causes, the first `batch` with the same gear order."""
    found = []
    for number in range(200):
        has = np.flatnonzero(rng.random(len(rates)) < rates)
        causes = [(f"cause_{k}", f"joint_{rng.integers(1, PLACES + 1)}") for k in has]
        shape = {}
        if number < batch:
            causes = [*causes, ("transmission_error", f"joint_{rng.integers(1, 4)}")]
            shape = {"order": 27.0 + 0.01 * rng.standard_normal()}
        found.append(stands(f"m{number}", verdict(*causes, **shape)))
    return found


def test_a_bad_batch_of_gears_shows_as_one() -> None:
    """At any joint, by their common order."""
    rng = np.random.default_rng(5)
    shared = shared_causes(fleet(rng, np.full(CAUSES, 0.01), batch=20), CAUSES, PLACES)
    assert [each.what for each in shared] == ["transmission error of order 27"]
    assert set(shared[0].machines) == {f"m{n}" for n in range(20)}
    assert shared[0].p_value < 1e-4


def test_the_order_that_sliding_joints_share_is_told_per_metre() -> None:
    machines = fleet(np.random.default_rng(5), np.full(CAUSES, 0.01), batch=20)
    for finding in (each for one in machines for each in one.findings):
        finding["shape_unit"] = dict.fromkeys(finding["shape"], "1/m")
    shared = shared_causes(machines, CAUSES, PLACES)
    assert [each.what for each in shared] == ["transmission error of order 27 per m"]


@pytest.mark.parametrize("spread", [0.0, 1.0])
def test_causes_by_chance_are_not_shared(spread: float) -> None:
    """With equal rates, and with rates whose logarithm scatters between causes."""
    rng = np.random.default_rng(6)
    alarms = 0
    for _ in range(12):
        rates = 0.015 * np.exp(spread * rng.standard_normal(CAUSES))
        told = shared_causes(fleet(rng, np.minimum(rates, 0.1)), CAUSES, PLACES)
        alarms += any(each.sure for each in told)
    assert alarms <= 1


def test_the_chance_is_the_binomial_one_where_all_rates_are_alike() -> None:
    counts = np.full(400, 2.0)
    expected, p = chance_of(counts, 0, 200)
    assert expected == pytest.approx(2.0, rel=0.01)
    assert p == pytest.approx(0.594, abs=0.01)  # 2 or more of 200, with 0.01 each
    counts[0] = 9.0
    assert chance_of(counts, 0, 200)[1] < 1e-3


def test_what_is_only_perhaps_shared_is_told_as_such() -> None:
    """And the number of machines with each cause, shared or not."""
    machines = [
        stands(f"press_{n}", verdict(("backlash", "joint_1")) if n < 3 else verdict())
        for n in range(8)
    ]
    names = tuple(each.machine for each in machines[:3])
    shared = [Shared("backlash", names, 8, 0.5, p) for p in (1e-4, 0.02)]
    page = page_of_fleet(machines, shared, {}, DAY, 90)
    told = {statement.question: statement.answer for statement in page.statements}
    sure, perhaps = told["What machines share"].split("in common. ")
    assert sure.startswith("Backlash in 3 of 8 machines")
    assert perhaps.startswith("Perhaps backlash in 3 of 8 machines")
    rows = {table.name: table.rows for table in page.tables()}
    assert [row[0] for row in rows["shared"]] == ["backlash", "perhaps backlash"]
    assert rows["frequent"] == (("backlash", "3"),)


def test_the_page_tells_states_visits_and_failures(tmp_path: Path) -> None:
    machines = [
        stands("press_1", verdict()),
        stands("press_2", verdict(("backlash", "joint_1")), failed=("day_3: no tracker",)),
        stands("press_3", verdict(), changes=(CHANGE,)),
    ]
    never = {"press_4": ("day_1: holds no recording",)}
    page = page_of_fleet(machines, (), never, DAY, 90)
    assert page.sentence == "1 of 3 machines is fine; 1 drifted and 1 with a cause."
    told = {statement.question: statement.answer for statement in page.statements}
    assert told["What to visit first"].startswith("press_3 (backlash at joint 2 changed")
    assert told["What machines share"] == "Nothing beyond what chance explains."
    assert told["What could not be used"].startswith("2 sessions; no result at all of press_4")
    rows = {table.name: table.rows for table in page.tables()}
    assert [row[0] for row in rows["visits"]] == ["press_3", "press_2"]
    assert ("press_4", "day_1: holds no recording") in rows["failed"]
    pytest.importorskip("plotly")
    from delta_calibration.report import page_of

    assert "press_3" in page_of(page)
