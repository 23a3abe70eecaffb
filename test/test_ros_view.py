"""Views of a cell from real nodes: markers, progress, URDF with joint states, diagnostics."""

from __future__ import annotations

import re
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from calibration_bench import (  # noqa: F401
    ROBOT,
    Cell,
    Q,
    desk_fixture,
    file_fixture,
    session_fixture,
)
from delta_calibration.cell.fitting import FIT_STEPS
from delta_calibration.plans import make_plan, nominal_joints
from delta_calibration.robot import load_robot
from delta_calibration.ros.conversions import joint_state, ns_to_stamp
from delta_calibration.ros.qos import DIAGNOSTICS, STATUS, STREAM_OUT
from delta_calibration.ros.robot_description import RobotDescription
from delta_calibration.ros.simulated_tracker import SimulatedTracker
from ros_helpers import Bench, bench_fixture  # noqa: F401
from urdf_reader import Urdf

pytestmark = pytest.mark.ros


class Watcher:
    """A late subscriber, such as RViz, Foxglove or rqt."""

    def __init__(self, bench: Bench) -> None:
        node = bench.node("watcher")
        self.bench = bench
        self.pictures: list[MarkerArray] = []
        self.progress: list[DiagnosticArray] = []
        self.told: list[DiagnosticStatus] = []
        name = "/calibration_node/"
        node.create_subscription(MarkerArray, name + "markers", self.pictures.append, STATUS)
        node.create_subscription(DiagnosticArray, name + "progress", self.progress.append, STATUS)
        node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.told.extend(m.status), DIAGNOSTICS
        )

    def sees(self, *names: str) -> dict[str, Marker]:
        """Wait for a picture with exactly these drawings."""
        wanted = set(names)
        assert self.bench.until(lambda: self.pictures and set(self.last) == wanted), set(self.last)
        return self.last

    @property
    def last(self) -> dict[str, Marker]:
        """The last picture by namespace."""
        clear, *markers = self.pictures[-1].markers
        assert clear.action == Marker.DELETEALL
        assert {m.header.frame_id for m in markers} == {"base_link"}
        return {marker.ns: marker for marker in markers}

    def tasks(self) -> list[DiagnosticStatus]:
        return [status for message in self.progress for status in message.status]


REGION = ("workspace", "region", "region edges", "nominal", "error calibrated")
FITTED = (*REGION, "error measured")


def test_a_late_watcher_sees_the_region_and_where_guards_acted(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    bench.spin_for(2.5)
    watcher = Watcher(bench)
    seen = watcher.sees(*REGION)
    assert seen["region"].type == Marker.TRIANGLE_LIST
    assert len(seen["region"].points) % 3 == 0
    assert 0.0 < seen["region"].color.a < 1.0
    cell.call("enable", True)
    far = nominal_joints(ROBOT, np.array([[0.66, 0.0, -0.711]]))[0]
    cell.give(Q)
    cell.give(far)
    dots = watcher.sees(*REGION, "guard: passed uncompensated")["guard: passed uncompensated"]
    assert dots.type == Marker.SPHERE_LIST
    (at,) = dots.points
    np.testing.assert_allclose([at.x, at.y, at.z], [0.66, 0.0, -0.711], atol=1e-9)


def test_a_fit_is_followed_and_its_errors_are_drawn(bench: Bench, session: Any) -> None:
    cell = Cell(bench, model="rotary_delta", error_scale=200.0)
    watcher = Watcher(bench)
    watcher.sees("workspace")
    assert bench.until(lambda: watcher.progress)
    assert watcher.progress[-1].status[0].message == "idle"
    assert cell.call("start_capture")[0]
    cell.measure(session)
    bench.spin_for(0.7)
    assert cell.call("stop_capture")[0]
    assert cell.call("fit")[0]
    assert bench.until(lambda: watcher.progress[-1].status[0].message == "idle")
    told = watcher.tasks()
    captured = [s for s in told if s.name == "/calibration_node/capture"]
    fitted = [s for s in told if s.name == "/calibration_node/fit"]
    counts = [int(values(s)["tracker messages"]) for s in captured]
    assert counts == sorted(counts)
    assert 0 < counts[-1] <= len(session.tracker.position)
    steps = [int(values(s)["steps done"]) for s in fitted]
    assert steps == sorted(steps)
    assert {values(s)["steps"] for s in fitted} == {str(len(FIT_STEPS))}
    drawn = watcher.sees(*FITTED)
    lines = drawn["error measured"]
    assert lines.type == Marker.LINE_LIST
    assert len(lines.points) == 2 * len(drawn["nominal"].points)
    ends = points(watcher)
    first = np.linalg.norm(ends[1::2] - ends[::2], axis=1)
    cell.node.set_parameters([Parameter("error_scale", value=100.0)])
    assert bench.until(lambda: not np.array_equal(ends, points(watcher)))
    half = points(watcher)
    second = np.linalg.norm(half[1::2] - half[::2], axis=1)
    np.testing.assert_allclose(second, first / 2, rtol=1e-6)


def test_work_quicker_than_the_period_is_told(
    bench: Bench, session: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("delta_calibration.ros.progress.PERIOD_S", 3600.0)
    cell = Cell(bench, model="rotary_delta")
    watcher = Watcher(bench)
    assert cell.call("start_capture")[0]
    cell.measure(session)
    assert cell.call("stop_capture")[0]
    assert cell.call("fit")[0]
    assert bench.until(lambda: [s.message for s in watcher.tasks()][-1:] == ["idle"])
    told = [s for s in watcher.tasks() if s.name == "/calibration_node/fit"]
    assert [values(s)["steps"] for s in told] == [str(len(FIT_STEPS))]


def points(watcher: Watcher) -> np.ndarray:
    return np.array([[p.x, p.y, p.z] for p in watcher.last["error measured"].points])


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


def test_a_picture_that_cannot_be_drawn_stops_no_command(
    bench: Bench, file: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    import delta_calibration.ros.markers as markers

    def broken(*_: object) -> None:
        raise RuntimeError("no paint")

    monkeypatch.setattr(markers, "scene", broken)
    cell = Cell(bench, calibration=file)
    bench.spin_for(2.5)
    assert cell.give(Q) is not None
    assert "no paint" in capfd.readouterr().err


@pytest.mark.parametrize("name", ["srbd", "linear_delta"])
def test_the_closed_chain_moves_with_the_joint_states(bench: Bench, name: str) -> None:
    robot = load_robot(name)
    given = [Parameter("robot", value=name), Parameter("rate", value=100.0)]
    node = bench.add(RobotDescription(context=bench.context, parameter_overrides=given))
    node.start()
    bench.spin_for(0.1)
    late = bench.node("viewer")
    texts: list[String] = []
    states: list[JointState] = []
    late.create_subscription(String, "robot_description", texts.append, STATUS)
    late.create_subscription(JointState, "joint_states_all", states.append, 100)
    world = late.create_publisher(JointState, "joint_states", STREAM_OUT)
    assert bench.until(lambda: texts and world.get_subscription_count())
    file = Urdf(texts[0].data)
    moving = {joint.name for joint in file.joints if joint.kind != "fixed"}
    model = robot.detailed
    for k, q in enumerate(make_plan("identify", robot, count=4, both_sides=False).joint):
        message = joint_state(robot.joints.names, q, ns_to_stamp(10**18 + k))
        message.name = [*message.name, "gripper"]
        message.position = array("d", [*message.position, 0.0])
        world.publish(message)
        assert bench.until(lambda k=k: len(states) > k)
        shown = states[-1]
        assert shown.header.stamp == message.header.stamp
        assert set(shown.name) == moving
        place = file.place("tool0", dict(zip(shown.name, shown.position, strict=True)))
        pose = model.forward(q[None], model.parameters.nominal)
        np.testing.assert_allclose(place[:3, 3], model.position(pose)[0], atol=1e-9)


def test_states_that_cannot_be_shown_are_told_and_do_not_stop_it(bench: Bench) -> None:
    given = [Parameter("robot", value="linear_delta"), Parameter("rate", value=100.0)]
    node = bench.add(RobotDescription(context=bench.context, parameter_overrides=given))
    watcher, world = Watcher(bench), bench.node("world")
    shown: list[JointState] = []
    world.create_subscription(JointState, "joint_states_all", shown.append, 100)
    states = world.create_publisher(JointState, "joint_states", STREAM_OUT)
    assert bench.until(states.get_subscription_count)
    names = load_robot("linear_delta").joints.names
    for torn, why in (([0.0, 0.0, 2.0], "cannot be assembled"), ([np.nan, 0.0, 0.0], "finite")):
        message = JointState(name=list(names), position=array("d", torn))
        states.publish(message)
        bench.spin_for(0.2)
        node._diagnostics.publish()
        assert bench.until(
            lambda why=why: any(
                s.level == DiagnosticStatus.WARN and why in s.message for s in watcher.told
            )
        )
        watcher.told.clear()
    assert shown == []
    states.publish(joint_state(names, np.full(3, 0.2), ns_to_stamp(1)))
    assert bench.until(lambda: shown)


def test_diagnostics_are_as_rqt_wants_them(bench: Bench, file: Path) -> None:
    """Names nest, the robot is the hardware, keys are unique, and numbers have units."""
    Cell(bench, calibration=file)
    for kind in (RobotDescription, SimulatedTracker):
        bench.add(kind(context=bench.context, namespace="/hall_2"))
    watcher = Watcher(bench)
    names = {"/calibration_node", "/hall_2/robot_description", "/hall_2/simulated_tracker"}
    assert bench.until(lambda: {s.name for s in watcher.told} == names)
    for status in watcher.told:
        assert status.hardware_id == "srbd"
        assert status.level in (DiagnosticStatus.OK, DiagnosticStatus.WARN)
        assert status.message
        keys = [pair.key for pair in status.values]
        assert len(set(keys)) == len(keys)
        for key, value in values(status).items():
            if re.fullmatch(r"[-+]?\d+\.\d*(e[-+]?\d+)?", value):  # a decimal number needs a unit
                assert re.search(r" \[[^]]+\]$", key), key
