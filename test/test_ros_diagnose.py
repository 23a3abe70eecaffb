"""`~/diagnose` of the calibration node diagnoses a live capture and uses the result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from calibration_bench import NAMES, ROBOT, T0_NS, Cell, Q, positions
from delta_calibration.calibration_file import load_calibration
from delta_calibration.plans import make_plan
from delta_calibration.ros.conversions import joint_state, ns_to_stamp
from delta_calibration.simulation import draw_machine, effect_options, simulate_session
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros

GAP = 0.4e-3  # [rad]


def test_a_play_found_in_a_running_cell_is_named_saved_and_corrected(
    bench: Bench, tmp_path: Path
) -> None:
    """For one place, the corrected commands from both sides differ by the gap."""
    machine = draw_machine(ROBOT, 5, hidden=[effect_options(f"backlash:value={GAP}")])
    plan = make_plan("identify", ROBOT, count=20, dwell=0.4)
    session = simulate_session(machine, plan, 5)
    out = tmp_path / "extended.yaml"
    cell = Cell(bench, output=out, ramp_s=0.0, max_correction_rate=100.0)
    yes, said = cell.call("diagnose")
    assert not yes
    assert "nothing was captured" in said
    assert cell.call("start_capture")[0]
    cell.measure(session)
    answer = cell.ask("diagnose")
    assert bench.until(answer.done, 60.0)
    assert answer.result().success, answer.result().message
    assert "backlash" in answer.result().message.lower()
    assert "not enabled" in answer.result().message
    named = cell.value("effects compensated")  # at rest, backlash and presliding are equivalent
    assert named in ("backlash", "stick_slip")

    assert cell.call("enable", True)[0]
    sent = {}
    for k, side in enumerate((-1.0, 1.0)):
        cell.give(Q + side * 0.02, T0_NS + (4 * k + 1) * 10**9)
        sent[side] = positions(cell.give(Q, T0_NS + (4 * k + 2) * 10**9))
    np.testing.assert_allclose(sent[-1.0] - sent[1.0], GAP, rtol=0.15)
    assert cell.call("save")[0]
    effects = load_calibration(out, ROBOT).chain.effects
    assert [effect.cause for effect in effects] == [named]


def test_a_diagnosis_that_cannot_be_made_says_why(bench: Bench) -> None:
    cell = Cell(bench)
    assert cell.call("start_capture")[0]
    for k in range(20):
        cell.states.publish(joint_state(NAMES, Q, ns_to_stamp(T0_NS + k * 10**8)))
    bench.spin_for(0.2)
    yes, said = cell.call("diagnose")
    assert not yes
    assert "no tracker readings" in said
