"""The calibration node in this process: what it sends, what it refuses, what it survives."""

from __future__ import annotations

import signal
import time
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter import Parameter
from ros_helpers import Bench, Launch, bench_fixture, launch_fixture  # noqa: F401
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from delta_calibration.cell.desk import Desk, Settings
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.ros.calibration_node import MARK, CalibrationNode
from delta_calibration.ros.conversions import joint_state, ns_to_stamp, stamp_to_ns
from delta_calibration.ros.qos import DIAGNOSTICS, MEASURED, STATUS, STREAM_OUT
from delta_calibration.simulation import draw_machine, simulate_session

pytestmark = pytest.mark.ros

ROBOT = load_robot("srbd")
NAMES = ROBOT.joints.names
MACHINE = draw_machine(ROBOT, 5)
T0_NS = 1_700_000_000_000_000_000
Q = make_plan("line", ROBOT, count=5).joint[4]
CLEARLY = 1e-5  # [rad] a correction is larger than this at Q


@pytest.fixture(scope="module")
def session() -> Any:
    return simulate_session(MACHINE, make_plan("identify", ROBOT, count=15, dwell=0.4), 5)


@pytest.fixture(scope="module")
def desk(session: Any) -> Desk:
    desk = Desk(Settings("srbd", model="rotary_delta"))
    desk.start_capture(0.0)
    for k, stamp in enumerate(session.states.stamp_ns.tolist()):
        desk.capture.add_states(stamp, session.states.position[k])
        desk.capture.add_tracker(stamp, session.tracker.position[k])
    desk.take(*desk.prepare_fit()())
    return desk


@pytest.fixture
def file(desk: Desk, tmp_path: Path) -> Path:
    path = tmp_path / "calibration.yaml"
    desk.save(str(path))
    return path


class Cell:
    """The node under test, with upstream, drives and an operator around it."""

    def __init__(self, bench: Bench, start: bool = True, **parameters: object) -> None:
        given = [
            Parameter(k, value=str(v) if isinstance(v, Path) else v) for k, v in parameters.items()
        ]
        self.bench = bench
        self.node = bench.add(CalibrationNode(context=bench.context, parameter_overrides=given))
        world = self.world = bench.node("world")
        self.command = world.create_publisher(JointState, "joint_command", STREAM_OUT)
        self.states = world.create_publisher(JointState, "joint_states", STREAM_OUT)
        self.tracker = world.create_publisher(PointStamped, "tracker/point", STREAM_OUT)
        self.sent: list[JointState] = []
        self.nominal: list[JointState] = []
        self.status: list[DiagnosticStatus] = []
        self.latched: list[DiagnosticStatus] = []
        name = "joint_command_compensated"
        self.sub = world.create_subscription(JointState, name, self.sent.append, 100)
        nominal = "joint_states_nominal"
        world.create_subscription(JointState, nominal, self.nominal.append, MEASURED)
        world.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.status.extend(m.status), DIAGNOSTICS
        )
        world.create_subscription(
            DiagnosticStatus, "/calibration_node/status", self.latched.append, STATUS
        )
        if start:
            self.node.trigger_configure()
            self.node.trigger_activate()
            self.found()

    def found(self) -> None:
        publishers = (self.command, self.states, self.tracker)
        assert self.bench.until(lambda: all(p.get_subscription_count() for p in publishers))
        assert self.bench.until(lambda: self.world.count_publishers("joint_command_compensated"))
        self.bench.spin_for(0.3)

    def give(self, q: np.ndarray, stamp_ns: int = T0_NS, frame: str = "") -> JointState | None:
        """Send a command; what comes out for it, None if nothing does."""
        message = JointState(name=list(NAMES), position=array("d", q.tolist()))
        message.header.stamp, message.header.frame_id = ns_to_stamp(stamp_ns), frame
        return self.answer(message)

    def answer(self, message: JointState) -> JointState | None:
        before = len(self.sent)
        self.command.publish(message)
        self.bench.until(lambda: len(self.sent) > before, 0.4)
        assert len(self.sent) <= before + 1
        return self.sent[-1] if len(self.sent) > before else None

    def call(self, name: str, value: bool | None = None) -> tuple[bool, str]:
        answer = self.ask(name, value)
        assert self.bench.until(answer.done)
        return answer.result().success, answer.result().message

    def ask(self, name: str, value: bool | None = None) -> Any:
        kind, request = Trigger, Trigger.Request()
        if value is not None:
            kind, request = SetBool, SetBool.Request(data=value)
        client = self.world.create_client(kind, f"/calibration_node/{name}")
        assert self.bench.until(client.service_is_ready)
        return client.call_async(request)

    def diagnosed(self, text: str, level: bytes = DiagnosticStatus.WARN) -> bool:
        self.status.clear()
        return self.bench.until(
            lambda: any(text in s.message and s.level == level for s in self.status), 4.0
        )

    def value(self, key: str) -> str:
        self.status.clear()
        assert self.bench.until(lambda: self.status)
        return {v.key: v.value for v in self.status[-1].values}[key]

    def measure(self, session: Any) -> None:
        for k, stamp in enumerate(session.states.stamp_ns.tolist()):
            self.states.publish(joint_state(NAMES, session.states.position[k], ns_to_stamp(stamp)))
            point = PointStamped()
            point.header.stamp = ns_to_stamp(stamp)
            point.point.x, point.point.y, point.point.z = session.tracker.position[k].tolist()
            self.tracker.publish(point)
            self.bench.until(lambda k=k: len(self.nominal) > k, 0.2)  # faster than a cell, no loss


def positions(message: JointState) -> np.ndarray:
    assert list(message.name) == list(NAMES)
    return np.array(message.position)


def test_a_command_is_passed_through_compensated_and_passed_again(
    bench: Bench, file: Path
) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    stamp = T0_NS + 123_456_789
    out = cell.give(Q, stamp)
    np.testing.assert_array_equal(positions(out), Q)
    assert (stamp_to_ns(out.header.stamp), out.header.frame_id) == (stamp, "")

    assert cell.call("enable", True)[0]
    out = cell.give(Q, stamp + 1)
    assert (stamp_to_ns(out.header.stamp), out.header.frame_id) == (stamp + 1, MARK)
    correction = positions(out) - Q
    assert np.abs(correction).max() > CLEARLY
    # What the compensation is for: the true tool is nearer to where the nominal robot meant it.
    errors = [true_error(cell.node._desk, q) for q in (Q, positions(out))]
    assert errors[1] < 0.1 * errors[0]

    cell.states.publish(joint_state(NAMES, positions(out), ns_to_stamp(stamp + 2)))
    assert bench.until(lambda: cell.nominal)
    np.testing.assert_allclose(positions(cell.nominal[-1]), Q, atol=1e-12)
    assert stamp_to_ns(cell.nominal[-1].header.stamp) == stamp + 2

    assert cell.call("enable", False)[0]
    np.testing.assert_allclose(positions(cell.give(Q, stamp + 3)), Q, atol=1e-15)


def true_error(desk: Desk, q: np.ndarray) -> float:
    """Distance of the true tool at q from the nominal one at Q, in the calibration's base [m]."""
    reading = MACHINE.chain.reading(MACHINE.chain.pose(q[None], MACHINE.theta), MACHINE.theta)
    reached = desk.calibration.tool_points(reading, q[None])[0]
    nominal = ROBOT.model("rotary_delta")
    meant = nominal.forward(Q[None], nominal.parameters.nominal)[0] + ROBOT.tool_offset
    return float(np.linalg.norm(reached - meant))


def test_the_correction_comes_without_a_jump(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.5)
    cell.give(Q, T0_NS)
    assert cell.call("enable", True)[0]
    end = time.monotonic() + 0.8
    out = []
    while time.monotonic() < end:
        out.append(positions(cell.give(Q, T0_NS)))
        bench.spin_for(0.005)
    steps = np.abs(np.diff([Q, *out], axis=0)).max(axis=1)
    whole = np.abs(out[-1] - Q).max()
    assert whole > CLEARLY
    assert len(out) > 20
    assert steps.max() < 0.5 * whole


def test_an_order_of_names_that_differs_is_understood(bench: Bench) -> None:
    cell = Cell(bench)
    message = JointState(name=[*NAMES[::-1], "gripper"], position=array("d", [*Q[::-1], 9.0]))
    np.testing.assert_array_equal(positions(cell.answer(message)), Q)


BAD: dict[str, Callable[[], JointState]] = {
    "finite values are needed": lambda: JointState(
        name=list(NAMES), position=array("d", [0.1, np.nan, 0.2])
    ),
    "found ['a', 'b', 'c']": lambda: JointState(name=["a", "b", "c"], position=array("d", Q)),
    "2 positions for": lambda: JointState(name=list(NAMES), position=array("d", [0.1, 0.2])),
    "found []": lambda: JointState(position=array("d", Q)),
}


@pytest.mark.parametrize("on_failure", ["pass_through", "hold"])
def test_malformed_commands_are_refused_told_and_dropped_or_held(
    bench: Bench, on_failure: str
) -> None:
    cell = Cell(bench, on_failure=on_failure)
    assert cell.answer(BAD["found []"]()) is None  # nothing to hold yet
    good = cell.give(Q)
    for said, make in BAD.items():
        out = cell.answer(make())
        if on_failure == "hold":
            np.testing.assert_array_equal(positions(out), positions(good))
        else:
            assert out is None
        assert said in cell.node._desk.health(time.monotonic(), 2.0).message
    assert cell.diagnosed("joint_command: JointState")
    assert cell.value("joint_command refused") == "5"
    np.testing.assert_array_equal(positions(cell.give(Q + 0.01)), Q + 0.01)


def test_malformed_states_and_readings_are_refused_and_the_path_goes_on(bench: Bench) -> None:
    cell = Cell(bench)
    cell.states.publish(JointState(name=list(NAMES), position=array("d", [np.inf, 0.0, 0.0])))
    point = PointStamped()
    point.point.x = float("nan")
    cell.tracker.publish(point)
    assert cell.diagnosed("tracker/point")
    assert cell.value("joint_states refused") == "1"
    assert cell.value("tracker/point refused") == "1"
    assert cell.nominal == []
    np.testing.assert_array_equal(positions(cell.give(Q)), Q)


def test_beyond_the_region_a_command_passes_or_the_last_good_one_is_held(
    bench: Bench, file: Path
) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    good = positions(cell.give(Q))
    far = np.full(3, 1.2)  # far below all that was measured
    np.testing.assert_array_equal(positions(cell.give(far)), far)
    assert cell.diagnosed("outside the calibrated region")
    cell.node.set_parameters([Parameter("on_failure", value="hold")])
    np.testing.assert_allclose(positions(cell.give(Q)), good, atol=1e-12)
    np.testing.assert_allclose(positions(cell.give(far)), good, atol=1e-12)
    assert cell.value("command outside the calibrated region") == "2"


def test_a_compensated_command_is_not_compensated_twice(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    once = cell.give(Q)
    assert once.header.frame_id == MARK
    twice = cell.answer(once)
    np.testing.assert_array_equal(positions(twice), positions(once))
    assert twice.header == once.header
    assert cell.diagnosed("already compensated")
    assert cell.value("command already compensated, passed unchanged") == "1"


def test_time_going_backwards_is_told_and_nothing_lost(bench: Bench) -> None:
    cell = Cell(bench)
    for stamp in (T0_NS, T0_NS + 5, T0_NS + 2):
        assert stamp_to_ns(cell.give(Q, stamp).header.stamp) == stamp
    assert cell.diagnosed("time went backwards")
    assert cell.value("command time went backwards") == "1"


def test_only_an_active_node_sends(bench: Bench) -> None:
    cell = Cell(bench)
    assert cell.give(Q) is not None
    cell.node.trigger_deactivate()
    assert cell.give(Q) is None
    cell.states.publish(joint_state(NAMES, Q, ns_to_stamp(T0_NS)))
    bench.spin_for(0.2)
    assert cell.nominal == []
    assert cell.diagnosed("inactive: nothing is sent", DiagnosticStatus.OK)
    yes, said = cell.call("start_capture")
    assert not yes
    assert "activate it first" in said
    cell.node.trigger_activate()
    assert cell.give(Q) is not None
    cell.node.trigger_deactivate()
    cell.node.trigger_cleanup()
    for service in ("start_capture", "stop_capture", "fit", "save", "reload"):
        yes, said = cell.call(service)
        assert not yes
        assert "configure it first" in said
    assert cell.give(Q) is None


def test_compensation_is_off_after_every_activation(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    cell.node.trigger_deactivate()
    cell.node.trigger_activate()
    np.testing.assert_array_equal(positions(cell.give(Q)), Q)


def test_transitions_out_of_state_are_answered_false(bench: Bench) -> None:
    cell = Cell(bench)
    client = cell.world.create_client(ChangeState, "/calibration_node/change_state")
    assert bench.until(client.service_is_ready)
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP, 99):
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = client.call_async(request)
        assert bench.until(answer.done)
        assert not answer.result().success
    assert cell.node.state == "active"
    assert cell.give(Q) is not None


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
    assert bench.until(lambda: cell.node._job is not None)
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
