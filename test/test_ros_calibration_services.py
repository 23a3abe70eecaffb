"""Services of the calibration node (capture, fit, save, reload), and unusable files."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.parameter import Parameter

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
from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.cell import calibration_session
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.fitting import FittedCalibration
from delta_calibration.compensation import JointCompensator, save_table
from delta_calibration.ros.conversions import joint_state, ns_to_stamp
from extended_bench import with_effects
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


@pytest.fixture(name="table")
def table_fixture(file: Path, tmp_path: Path) -> Path:
    path = tmp_path / "corrections.npz"
    made = JointCompensator(load_calibration(file, ROBOT), "table")
    save_table(path, made.table)
    return path


def test_a_table_is_read_from_its_file(bench: Bench, file: Path, table: Path) -> None:
    cell = Cell(bench, calibration=file, method="table", table=table, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    exact = JointCompensator(load_calibration(file, ROBOT)).compensate(Q[None]).joint[0]
    np.testing.assert_allclose(positions(cell.give(Q)), exact, atol=3e-6)
    assert np.abs(positions(cell.give(Q)) - Q).max() > CLEARLY
    assert cell.diagnosed("compensating by table (", DiagnosticStatus.OK)


def test_a_stale_table_is_refused_and_diagnostics_say_so(
    bench: Bench, desk: CalibrationSession, file: Path, table: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.yaml"
    drift = with_effects(desk.fitted.found, ROBOT, {"joint_zero_drift": ({}, 1e-3)})
    save_calibration(other, drift, ROBOT, desk.fitted.poses)
    named = {"calibration": other, "table": table, "data_dir": os.path.commonpath([other, file])}
    cell = Cell(bench, start=False, method="table", **named)
    cell.node.trigger_configure()
    assert cell.node.state == "unconfigured"
    assert cell.diagnosed(f"{table}: the table is outdated", DiagnosticStatus.ERROR)
    cell.node.set_parameters([Parameter("calibration", value=str(file))])
    cell.node.trigger_configure()
    cell.node.trigger_activate()
    cell.found()
    assert cell.diagnosed("compensation is off", DiagnosticStatus.OK)
    cell.node.set_parameters([Parameter("calibration", value=str(other))])
    yes, said = cell.call("reload")
    assert not yes
    assert "the table is outdated" in said
    assert cell.diagnosed(f"reload: {table}: the table is outdated")
    assert cell.call("enable", True)[0]  # the previous calibration stays in use


class Gate:
    """Replaces a function; calls wait until the gate is opened, and their threads are recorded."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function, self._open = function, threading.Event()
        self.threads: list[int] = []

    def __call__(self, *arguments: Any) -> Any:
        self.threads.append(threading.get_ident())
        assert self._open.wait(60.0)
        return self._function(*arguments)

    def open(self) -> None:
        self._open.set()


@pytest.mark.parametrize("service", ["save", "reload"])
def test_no_command_waits_for_a_file(
    bench: Bench,
    desk: CalibrationSession,
    file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    service: str,
) -> None:
    cell = Cell(bench, calibration=file, output=tmp_path / "saved.yaml", ramp_s=0.0)
    cell.node._desk.fitted = desk.fitted
    assert cell.call("enable", True)[0]
    gate = {
        "save": Gate(FittedCalibration.save),
        "reload": Gate(calibration_session.load_calibration),
    }[service]
    if service == "save":
        monkeypatch.setattr(FittedCalibration, "save", lambda *arguments: gate(*arguments))
    else:
        monkeypatch.setattr(calibration_session, "load_calibration", gate)
    answer = cell.ask(service)
    assert bench.until(lambda: gate.threads)
    for k in range(100):  # the file is not finished while the gate is closed
        assert cell.give(Q + 1e-5 * k, T0_NS + k * 1_000_000) is not None
    assert not answer.done()
    gate.open()
    assert bench.until(answer.done)
    assert answer.result().success
    assert threading.get_ident() not in gate.threads  # the thread of the callbacks
    assert cell.give(Q) is not None


def test_a_live_fit_is_the_fit_of_the_session_and_commands_go_on_meanwhile(
    bench: Bench, session: Any, desk: CalibrationSession, tmp_path: Path
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
        assert cell.give(Q + 1e-3 * (during % 100)) is not None
        during += not first.done()
    assert during > 0
    assert bench.until(second.done)
    assert not second.result().success
    assert "running already" in second.result().message
    assert first.result().success
    assert desk.fitted.sentence() in first.result().message
    assert "not enabled" in first.result().message
    for _ in range(200):  # the ramp starts at the drives' position in joint_states
        sent = positions(cell.give(Q))
        if np.array_equal(sent, Q):
            break
        time.sleep(0.01)
    np.testing.assert_array_equal(sent, Q)
    assert cell.call("save")[0]
    saved = CalibrationSession(Settings("srbd", calibration=str(out))).calibration
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
