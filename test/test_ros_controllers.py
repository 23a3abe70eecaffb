"""Outputs for controllers of ros2_control, trajectories, and inputs that the node refuses."""

from __future__ import annotations

import time
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from builtin_interfaces.msg import Duration
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from calibration_bench import (  # noqa: F401
    CLEARLY,
    NAMES,
    T0_NS,
    Cell,
    Q,
    desk_fixture,
    file_fixture,
    positions,
    session_fixture,
)
from delta_calibration.ros.calibration_node import MARK
from delta_calibration.ros.qos import CONTROLLER
from delta_calibration.ros.trajectories import REPLACED
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros

TURNED = ("joint_3", "joint_1", "joint_2")


def heard(cell: Cell, kind: Any, topic: str) -> list[Any]:
    messages: list[Any] = []
    cell.world.create_subscription(kind, topic, messages.append, CONTROLLER)
    assert cell.bench.until(lambda: cell.world.count_publishers(topic), 5.0)
    cell.bench.spin_for(0.3)
    return messages


def test_controllers_get_nothing_unless_named(bench: Bench) -> None:
    cell = Cell(bench)
    topics = {name for name, _ in cell.world.get_topic_names_and_types()}
    assert not [t for t in topics if t.endswith(("/commands", "/joint_trajectory"))]


def test_commands_go_to_the_controllers_in_their_order(bench: Bench, file: Path) -> None:
    cell = Cell(
        bench,
        calibration=file,
        ramp_s=0.0,
        command_controller="forward",
        command_joints=list(TURNED),
        trajectory_controller="following",
    )
    commands = heard(cell, Float64MultiArray, "forward/commands")
    trajectories = heard(cell, JointTrajectory, "following/joint_trajectory")
    assert cell.call("enable", True)[0]
    out = positions(cell.give(Q))
    assert np.abs(out - Q).max() > CLEARLY
    assert bench.until(lambda: commands and trajectories)
    np.testing.assert_array_equal(commands[-1].data, out[[2, 0, 1]])
    sent = trajectories[-1]
    assert (list(sent.joint_names), sent.header.frame_id) == (list(NAMES), MARK)
    assert (sent.header.stamp.sec, sent.header.stamp.nanosec) == (0, 0)
    np.testing.assert_array_equal(sent.points[0].positions, out)
    cell.node.trigger_deactivate()
    cell.node.trigger_cleanup()
    assert bench.until(lambda: not cell.world.count_publishers("forward/commands"))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"command_controller": "c", "command_joints": ["joint_1", "elbow"]}, "command_joints"),
        ({"trajectory_input": "in"}, "needs a trajectory_controller"),
        ({"command_controller": "9 bad"}, "parameter command_controller: '9 bad'"),
        ({"trajectory_controller": "//"}, "parameter trajectory_controller: '//'"),
    ],
)
def test_controllers_that_cannot_be_refuse_to_configure(
    bench: Bench, capfd: pytest.CaptureFixture[str], given: dict[str, Any], said: str
) -> None:
    cell = Cell(bench, start=False, **given)
    cell.node.trigger_configure()
    assert cell.node.state == "unconfigured"
    told = capfd.readouterr().err
    assert said in told
    assert "Traceback" not in told


def planned(*rows: np.ndarray, names: tuple[str, ...] = NAMES) -> JointTrajectory:
    message = JointTrajectory(joint_names=list(names))
    for k, q in enumerate(rows):
        point = JointTrajectoryPoint(positions=array("d", q), velocities=array("d", 0.1 * q))
        point.time_from_start = Duration(sec=k + 1)
        message.points.append(point)
    return message


def test_a_trajectory_is_compensated_point_by_point(bench: Bench, file: Path) -> None:
    cell = Cell(
        bench,
        calibration=file,
        ramp_s=0.0,
        trajectory_controller="following",
        trajectory_input="planned",
    )
    out = heard(cell, JointTrajectory, "following/joint_trajectory")
    commander = cell.world.create_publisher(JointTrajectory, "planned", CONTROLLER)
    assert bench.until(commander.get_subscription_count)
    assert cell.call("enable", True)[0]
    expected = [positions(cell.give(q)) for q in (Q, Q + 0.01)]
    assert out == []  # single commands are not sent to a trajectory controller
    rows = [q[[2, 0, 1]] for q in (Q, Q + 0.01)]
    commander.publish(planned(*rows, names=TURNED))
    assert bench.until(lambda: out)
    sent = out[-1]
    assert (list(sent.joint_names), sent.header.frame_id) == (list(NAMES), MARK)
    assert [p.time_from_start.sec for p in sent.points] == [1, 2]
    np.testing.assert_allclose([p.positions for p in sent.points], expected, atol=1e-12)
    np.testing.assert_allclose(sent.points[0].velocities, 0.1 * Q, rtol=0.02)
    commander.publish(sent)  # it is marked, so it is not compensated again
    assert bench.until(lambda: len(out) == 2)
    np.testing.assert_array_equal(out[1].points[0].positions, sent.points[0].positions)

    bad = {
        "expected each of the joints": planned(Q, names=("joint_1", "joint_2", "elbow")),
        "is empty": planned(),
        "finite values are needed": planned(Q * np.nan),
        "has to rise": planned(Q, Q),
    }
    bad["has to rise"].points[1].time_from_start = Duration(sec=1)
    for said, message in bad.items():
        commander.publish(message)
        assert bench.until(
            lambda s=said: s in cell.node._desk.health(time.monotonic(), 2.0).message, 3.0
        ), said
    cell.node.set_parameters([Parameter("on_failure", value="hold")])
    commander.publish(planned(Q, np.full(3, 1.2)))
    assert cell.diagnosed("point 1: outside the calibrated region")
    assert cell.value("command trajectory refused") == "1"
    assert cell.value("planned refused") == "5"
    assert len(out) == 2


def test_a_stale_command_is_not_sent_and_told(bench: Bench) -> None:
    cell = Cell(bench, command_timeout_s=5.0)
    now_ns = cell.node.get_clock().now().nanoseconds
    assert cell.give(Q, T0_NS) is None
    assert cell.diagnosed("older than the timeout")
    assert cell.value("command older than the timeout") == "1"
    assert cell.give(Q, now_ns) is not None
    assert cell.give(Q, 0) is not None  # the age of a command without a stamp is not known
    cell.node.set_parameters([Parameter("command_timeout_s", value=0.0)])
    assert cell.give(Q, T0_NS) is not None


def test_a_command_that_was_sent_is_not_compensated_again_unmarked(
    bench: Bench, file: Path
) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    once = positions(cell.give(Q))
    np.testing.assert_array_equal(positions(cell.give(once)), once)
    assert cell.diagnosed("own output received")


def test_commands_are_answered_while_a_long_trajectory_is_worked_on(
    bench: Bench, file: Path
) -> None:
    """Commands after a trajectory of ten thousand points do not wait a second for its end."""
    cell = Cell(
        bench,
        calibration=file,
        ramp_s=0.0,
        trajectory_controller="following",
        trajectory_input="planned",
    )
    out = heard(cell, JointTrajectory, "following/joint_trajectory")
    commander = cell.world.create_publisher(JointTrajectory, "planned", CONTROLLER)
    assert bench.until(commander.get_subscription_count)
    assert cell.call("enable", True)[0]
    long = JointTrajectory(joint_names=list(NAMES))
    for row in range(10_000):
        point = JointTrajectoryPoint(positions=(Q + 1e-5 * row).tolist())
        point.time_from_start.sec, point.time_from_start.nanosec = row // 1000, row % 1000 * 10**6
        long.points.append(point)
    commander.publish(long)
    before, answered = len(cell.sent), 0
    while not out and answered < 10_000:
        cell.give(Q)
        answered += 1
    assert answered > 3
    assert len(cell.sent) - before >= answered - 1
    assert bench.until(lambda: out)
    assert len(out[0].points) == 10_000
    sent = np.array([p.positions for p in out[0].points])
    assert np.abs(sent - [p.positions for p in long.points]).max() > CLEARLY


def test_a_trajectory_that_is_worked_on_is_dropped_with_the_node(bench: Bench, file: Path) -> None:
    cell = Cell(
        bench,
        calibration=file,
        trajectory_controller="following",
        trajectory_input="planned",
    )
    out = heard(cell, JointTrajectory, "following/joint_trajectory")
    line = cell.node._trajectories
    long = JointTrajectory(joint_names=list(NAMES))
    long.points = [JointTrajectoryPoint(positions=Q.tolist())]
    for _ in range(3):
        line.take(cell.node._desk, serialize_message(long))
    assert cell.node._desk.path.counts[REPLACED] == 1
    assert cell.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    bench.until(lambda: out, 0.3)
    assert out == []
