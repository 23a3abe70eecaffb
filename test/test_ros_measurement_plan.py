"""The commands of a plan in real time, as a process and as arrays."""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from delta_calibration.errors import InputError, ReachError
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.ros.conversions import joint_state, stamp_to_ns
from delta_calibration.ros.driven import LASTS_S, Driven
from delta_calibration.ros.lifecycle import SafeLifecycleNode
from delta_calibration.ros.measurement_plan import MeasurementPlan, Motion
from delta_calibration.ros.qos import COMMAND, DIAGNOSTICS, MEASURED, STATUS, STREAM_OUT
from ros_helpers import Bench, Launch, NodeProcess, bench_fixture, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros

NODE = "delta_calibration.ros.measurement_plan"
ROBOT = load_robot("srbd")
NAMES = ROBOT.joints.names
RATE = 100.0  # [1/s]
HERE = np.array([0.05, -0.02, 0.1])  # [rad] position of the machine


@pytest.fixture
def points(tmp_path: Path) -> Path:
    """Three points in a CSV file."""
    path = tmp_path / "points.csv"
    path.write_text("x_mm,y_mm,z_mm\n0,0,-711\n40,-40,-711\n-50,20,-730\n")
    return path


class Listener:
    """Publishes a fixed position of the machine, and records the commands."""

    def __init__(self, bench: Bench, measured: bool = True, nominal: bool = False) -> None:
        self.bench = bench
        node = bench.node("listener")
        self.names: list[list[str]] = []
        self.stamps: list[int] = []
        self.angles: list[list[float]] = []
        self.said: list[DiagnosticStatus] = []
        node.create_subscription(JointState, "joint_command", self._on_command, COMMAND)
        node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.said.extend(m.status), DIAGNOSTICS
        )
        self.progress: list[DiagnosticStatus] = []
        node.create_subscription(
            DiagnosticArray,
            "/measurement_plan/progress",
            lambda m: self.progress.extend(m.status),
            STATUS,
        )
        if measured:
            self._publish(node, "joint_states", HERE, MEASURED)
        if nominal:
            self._publish(node, "joint_states_nominal", HERE - 0.01, STREAM_OUT)

    @staticmethod
    def _publish(node: object, topic: str, joint: np.ndarray, qos: object) -> None:
        publisher = node.create_publisher(JointState, topic, qos)
        message = joint_state(NAMES, joint, node.get_clock().now().to_msg())
        node.create_timer(0.05, partial(publisher.publish, message))

    def _on_command(self, message: JointState) -> None:
        self.names.append(list(message.name))
        self.stamps.append(stamp_to_ns(message.header.stamp))
        self.angles.append(list(message.position))

    def until_end(self, node: NodeProcess) -> int:
        assert self.bench.until(lambda: node.process.poll() is not None, 30.0)
        self.bench.spin_for(0.1)
        return node.end()


def expected(points: Path, start: np.ndarray | None, **options: object) -> np.ndarray:
    plan = make_plan(str(points), ROBOT, **options)
    return Motion.of(plan, ROBOT, RATE, start).joint


def test_every_command_comes_at_its_time_from_where_the_machine_stands(
    bench: Bench, launch: Launch, points: Path
) -> None:
    listener = Listener(bench)
    node = launch(NODE, plan=points, dwell=0.2, rate=RATE)
    assert listener.until_end(node) == 0
    commands = expected(points, HERE, dwell=0.2)
    np.testing.assert_allclose(listener.angles, commands, atol=1e-12)
    assert set(map(tuple, listener.names)) == {NAMES}
    # single delays are possible, but no command is early and delays do not accumulate
    told = np.array(listener.stamps) * 1e-9
    late = told - told[0] - np.arange(len(commands)) / RATE
    assert late.min() > -0.02
    assert np.median(np.diff(told)) == pytest.approx(1 / RATE, rel=0.1)
    assert np.all(np.diff(told) > 0)
    assert "plan points: 6 stops and paths" in node.output
    assert "6 of 6" in node.output
    mine = [s for s in listener.said if s.name == "/measurement_plan"]
    assert any(s.message.startswith("at ") and s.message.endswith(" of 6") for s in mine)
    assert mine[-1].message == "done"
    *going, last = listener.progress[1:]  # idle until the listener was found
    assert {status.name for status in going} == {"/measurement_plan/plan"}
    done = [float({v.key: v.value for v in status.values}["done [%]"]) for status in going]
    assert len(done) >= 2
    assert done == sorted(done)
    assert 0.0 <= done[0] < done[-1] <= 100.0
    assert (last.name, last.message) == ("/measurement_plan", "idle")


def test_where_upstream_sees_the_machine_comes_first(
    bench: Bench, launch: Launch, points: Path
) -> None:
    listener = Listener(bench, nominal=True)
    node = launch(NODE, plan=points, dwell=0.0, both_sides=False, rate=RATE)
    assert listener.until_end(node) == 0
    commands = expected(points, HERE - 0.01, dwell=0.0, both_sides=False)
    np.testing.assert_allclose(listener.angles, commands, atol=1e-12)


def test_without_joint_states_it_begins_at_the_first_stop(
    bench: Bench, launch: Launch, points: Path
) -> None:
    listener = Listener(bench, measured=False)
    node = launch(NODE, plan=points, dwell=0.0, both_sides=False, rate=RATE)
    assert listener.until_end(node) == 0
    assert "no joint states" in node.output
    np.testing.assert_allclose(listener.angles[0], expected(points, None)[0], atol=1e-12)


def _longest_run(flags: NDArray[np.bool_]) -> int:
    return max(len(list(run)) * flag for flag, run in groupby(flags.tolist()))


def test_after_a_hold_up_it_goes_on_without_a_jump(
    bench: Bench, launch: Launch, points: Path
) -> None:
    listener = Listener(bench)
    node = launch(NODE, plan=points, dwell=0.2, rate=RATE)
    assert bench.until(lambda: len(listener.angles) > 20)
    node.send(signal.SIGSTOP)
    bench.spin_for(0.8)
    count = len(listener.angles)
    node.send(signal.SIGCONT)
    assert listener.until_end(node) == 0
    gaps = np.diff(listener.stamps[count:]) * 1e-9
    # a delay of 0.25 s is made up for, one of 0.8 s is not: 80 commands would come at once
    assert _longest_run(gaps < 0.3 / RATE) < 50
    assert "delayed: the rest of the plan is" in node.output
    np.testing.assert_allclose(listener.angles, expected(points, HERE, dwell=0.2), atol=1e-12)


def test_payloads_are_asked_for(bench: Bench, launch: Launch) -> None:
    Listener(bench)
    node = launch(NODE, plan="rich", count=1, dwell=0.0)
    assert bench.until(lambda: "the plan needs 2 kg on the platform" in node.output)
    node.send(signal.SIGINT)
    assert bench.until(lambda: node.process.poll() is not None)
    assert node.end() == 0


def test_when_nobody_listens_it_ends_with_1(launch: Launch, points: Path) -> None:
    node = launch(NODE, plan=points, wait_for_subscriber=0.3)
    assert node.end() == 1
    assert "did not begin in 0.3 s: nobody listens to /joint_command" in node.output
    assert len(node.output.strip().splitlines()) == 1


class Managed(SafeLifecycleNode):
    """Listens to commands from configure to cleanup, as the calibration node does."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("calibration_node", **kwargs)
        self.heard: list[JointState] = []

    def configure(self) -> None:
        self.commands = self.create_subscription(
            JointState, "joint_command", self.heard.append, COMMAND
        )

    def cleanup(self) -> None:
        self.destroy_subscription(self.commands)


@pytest.fixture
def managed(bench: Bench) -> Managed:
    node = bench.add(Managed(context=bench.context))
    node.trigger_configure()
    return node


def gone(bench: Bench, node: Managed) -> None:
    bench.executor.remove_node(node)
    bench.nodes.remove(node)
    node.destroy_node()


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        (
            lambda _, node: node.trigger_deactivate(),
            "/calibration_node is inactive and forwards nothing",
        ),
        (
            lambda _, node: node.trigger_shutdown(),
            "no longer listens to /joint_command, and was active",
        ),
        (gone, "/calibration_node no longer listens to /joint_command, and was active"),
        (lambda bench, node: bench.executor.remove_node(node), "has not reported for 3 s whether"),
    ],
    ids=["inactive", "finalized", "gone", "hangs"],
)
def test_it_stops_where_the_node_that_it_drives_is_not_active(
    bench: Bench,
    launch: Launch,
    managed: Managed,
    ends: Callable[[Bench, Managed], object],
    said: str,
) -> None:
    managed.trigger_activate()
    listener = Listener(bench)  # another listener stays, such as a recorder
    node = launch(NODE, plan="line", dwell=1.0)
    assert bench.until(lambda: len(managed.heard) > 20)
    ends(bench, managed)
    assert listener.until_end(node) == 1
    assert " of 122: /calibration_node" in node.output
    assert said in node.output
    mine = [s for s in listener.said if s.name == "/measurement_plan"]
    assert mine[-1].level == DiagnosticStatus.ERROR
    assert mine[-1].message.startswith("stopped at ")
    assert said in mine[-1].message


def test_it_waits_for_the_node_to_be_active(
    bench: Bench, launch: Launch, points: Path, managed: Managed
) -> None:
    listener = Listener(bench)
    node = launch(NODE, plan=points, dwell=0.0, rate=RATE)
    waits = "waiting: /calibration_node is inactive and forwards nothing; activate it"
    assert bench.until(lambda: any(s.message == waits for s in listener.said))
    assert managed.heard == []
    managed.trigger_activate()
    assert listener.until_end(node) == 0
    assert len(managed.heard) == len(listener.angles) > 0


def test_a_node_that_stays_inactive_is_named_in_the_end(
    bench: Bench, launch: Launch, points: Path, managed: Managed
) -> None:
    node = launch(NODE, plan=points, wait_for_subscriber=6.0)
    assert bench.until(lambda: node.process.poll() is not None)
    assert node.end() == 1
    assert "did not begin in 6 s: /calibration_node is inactive" in node.output
    assert managed.heard == []


def test_when_a_listener_is_gone_it_stops(bench: Bench, launch: Launch, points: Path) -> None:
    listener = Listener(bench)
    other = bench.node("recorder")
    recorder = other.create_subscription(JointState, "joint_command", lambda _: None, COMMAND)
    node = launch(NODE, plan=points, subscribers=2, rate=RATE)
    assert bench.until(lambda: len(listener.angles) > 20)
    other.destroy_subscription(recorder)
    assert listener.until_end(node) == 1
    assert "only 1 of 2 listens to /joint_command" in node.output


@pytest.mark.parametrize(
    ("name", "value", "error", "said"),
    [
        ("plan", "/no/such/points.csv", InputError, "/no/such/points.csv: cannot be read"),
        ("dwell", -1.0, InputError, r"^parameter dwell: -1.0 is not in \[0.0, 3600.0\]$"),
        ("rate", 50, InputError, "parameter rate: 50 is not of type float; write 50.0"),
        ("plan", "far.csv", ReachError, "point 1"),
        ("plan", "separate:backlash", InputError, "two causes are expected"),
    ],
)
def test_wrong_parameters_are_refused(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    value: object,
    error: type[Exception],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("far.csv").write_text("x_mm,y_mm,z_mm\n5000,0,-711\n")
    with pytest.raises(error, match=said):
        MeasurementPlan(context=bench.context, parameter_overrides=[Parameter(name, value=value)])


def test_wrong_use_is_one_line_and_2(launch: Launch) -> None:
    node = launch(NODE, plan="spiral")
    assert node.end() == 2
    assert f"no plan '{Path.cwd() / 'spiral'}'; there are: line, disc" in node.output
    assert len(node.output.strip().splitlines()) == 1


@pytest.mark.parametrize("name", ["line", "disc", "identify", "iso9283", "circles", "rich"])
def test_a_motion_has_no_jumps_and_visits_every_stop(name: str) -> None:
    plan = make_plan(name, ROBOT, count=3, dwell=0.2)
    motion = Motion.of(plan, ROBOT, RATE, HERE)
    np.testing.assert_array_equal(motion.joint[0], HERE)
    fastest = np.abs(np.diff(motion.joint, axis=0)).max() * RATE
    assert fastest < 1.05 * ROBOT.joints.speed
    assert np.all(np.diff(motion.leg) >= 0)
    assert motion.leg_count >= len(plan)
    for stop in range(len(plan)):
        joint = motion.joint[motion.leg == stop]
        np.testing.assert_array_equal(joint[-int(0.2 * RATE) :], [plan.joint[stop]] * 20)
    np.testing.assert_array_equal(np.unique(motion.payload), np.unique(plan.payload))


def test_who_is_missing_counts_once_it_has_lasted(bench: Bench) -> None:
    """Nodes that end with one Ctrl-C disappear one after another."""
    node = bench.node("drives")
    driven = Driven(node, node.create_publisher(JointState, "joint_command", 10), 1)
    assert driven.lasting_trouble() == ""
    bench.spin_for(0.6 * LASTS_S)
    assert driven.lasting_trouble() == ""
    bench.spin_for(0.6 * LASTS_S)
    assert driven.lasting_trouble() == "nobody listens to /joint_command"
