"""The calibration node asked to capture, fit, save and reload; and files that are no good."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticStatus

from calibration_bench import (  # noqa: F401
    CLEARLY,
    MACHINE,
    NAMES,
    ROBOT,
    T0_NS,
    Cell,
    Q,
    desk_fixture,
    file_fixture,
    positions,
    session_fixture,
)
from delta_calibration.cell.desk import Desk, Settings
from delta_calibration.ros.conversions import joint_state, ns_to_stamp
from ros_helpers import Bench, Launch, bench_fixture, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("harm", ["half", "gone"])
def test_a_calibration_that_cannot_be_read_refuses_to_configure(
    bench: Bench, file: Path, capfd: pytest.CaptureFixture[str], harm: str
) -> None:
    content = file.read_bytes()
    file.unlink()
    if harm == "half":
        file.write_bytes(content[: len(content) // 2])
    cell = Cell(bench, start=False, calibration=file)
    cell.node.trigger_configure()
    assert cell.node.state == "unconfigured"
    said = capfd.readouterr().err
    assert f"configure: {file}" in said
    assert "Traceback" not in said
    assert not cell.command.get_subscription_count()
    file.write_bytes(content)
    cell.node.trigger_configure()
    assert cell.node.state == "inactive"


def test_a_reload_of_a_bad_file_keeps_the_calibration_in_force(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    before = positions(cell.give(Q))
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    yes, said = cell.call("reload")
    assert not yes
    assert str(file) in said
    np.testing.assert_array_equal(positions(cell.give(Q)), before)
    file.write_bytes(content)
    yes, said = cell.call("reload")
    assert yes
    assert "compensation is on" in said


def test_a_live_fit_is_the_fit_of_the_session_and_commands_go_on_meanwhile(
    bench: Bench, session: Any, desk: Desk, tmp_path: Path
) -> None:
    out = tmp_path / "fitted.yaml"
    cell = Cell(bench, model="rotary_delta", output=out)
    assert not cell.call("save")[0]
    assert cell.call("start_capture")[0]
    cell.measure(session)
    bench.spin_for(0.2)
    yes, said = cell.call("stop_capture")
    assert yes
    count = len(session.states.stamp_ns)
    assert f"{count} joint_states, {count} tracker" in said

    first, second = cell.ask("fit"), cell.ask("fit")
    during = 0
    while not first.done():
        assert cell.give(Q + 1e-3 * during) is not None
        during += not first.done()
    assert during > 0
    assert bench.until(second.done)
    assert not second.result().success
    assert "running already" in second.result().message
    assert first.result().success
    assert desk.fitted.sentence() in first.result().message
    assert "not enabled" in first.result().message
    np.testing.assert_array_equal(positions(cell.give(Q)), Q)
    assert cell.call("save")[0]
    saved = Desk(Settings("srbd", calibration=str(out))).calibration
    np.testing.assert_allclose(saved.theta, desk.calibration.theta, rtol=1e-9)


def test_a_fit_that_cannot_be_made_says_why_and_keeps_what_was(
    bench: Bench, file: Path, session: Any
) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    before = positions(cell.give(Q))
    yes, said = cell.call("fit")
    assert not yes
    assert "nothing was captured" in said
    assert cell.call("start_capture")[0]
    for k in range(20):
        stamp = ns_to_stamp(int(session.states.stamp_ns[k]))
        cell.states.publish(joint_state(NAMES, session.states.position[k], stamp))
    bench.spin_for(0.2)
    yes, said = cell.call("fit")
    assert not yes
    assert "no tracker readings" in said
    np.testing.assert_array_equal(positions(cell.give(Q)), before)


def test_a_silent_tracker_is_told_while_capturing(bench: Bench) -> None:
    cell = Cell(bench, tracker_timeout_s=0.5)
    assert cell.diagnosed("no calibration", DiagnosticStatus.OK)
    assert cell.call("start_capture")[0]
    assert cell.diagnosed("tracker silent for")
    assert bench.until(lambda: any("tracker silent" in s.message for s in cell.latched))
    assert cell.call("stop_capture")[0]
    assert cell.diagnosed("no calibration", DiagnosticStatus.OK)


def test_a_fit_in_a_node_that_is_cleaned_up_is_answered_false(bench: Bench, session: Any) -> None:
    cell = Cell(bench)
    assert cell.call("start_capture")[0]
    cell.measure(session)
    answer = cell.ask("fit")
    assert bench.until(lambda: cell.node._jobs.running)
    cell.node.trigger_deactivate()
    cell.node.trigger_cleanup()
    assert bench.until(answer.done)
    assert not answer.result().success
    assert "cleaned up" in answer.result().message
    cell.node.trigger_configure()
    assert not cell.node._desk.path.loaded


def test_a_process_with_a_half_written_calibration_stays_up_and_says_so(
    launch: Launch, file: Path
) -> None:
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    node = launch("delta_calibration.ros.calibration_node", autostart=True, calibration=file)
    assert node.says(f"configure: {file}")
    assert node.process.poll() is None
    node.send(signal.SIGINT)
    assert node.end() == 0
    assert "Traceback" not in node.output
