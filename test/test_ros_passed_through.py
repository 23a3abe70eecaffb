"""Axes outside the model in the live node: messages, bytes, trajectories, controllers."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
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
from delta_calibration.ros.conversions import ns_to_stamp
from delta_calibration.ros.qos import CONTROLLER
from ros_helpers import Bench, bench_fixture  # noqa: F401
from test_passed_through import TURN, written

pytestmark = pytest.mark.ros
EVERY = (*NAMES, TURN)


def command(values: np.ndarray, names: tuple[str, ...], stamp_ns: int = T0_NS) -> JointState:
    message = JointState(name=list(names), position=array("d", values.tolist()))
    message.header.stamp = ns_to_stamp(stamp_ns)
    return message


def heard(cell: Cell, kind: Any, topic: str) -> list[Any]:
    messages: list[Any] = []
    cell.world.create_subscription(kind, topic, messages.append, CONTROLLER)
    assert cell.bench.until(lambda: cell.world.count_publishers(topic), 5.0)
    cell.bench.spin_for(0.3)
    return messages


def test_commands_and_states_carry_it(bench: Bench, file: Path, tmp_path: Path) -> None:
    """The first message of a layout is read by rclpy, later ones as bytes."""
    cell = Cell(bench, robot=written(tmp_path, TURN), calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    plain = positions(cell.give(Q))
    assert np.abs(plain - Q).max() > CLEARLY
    assert list(cell.sent[-1].name) == list(NAMES)
    names = (TURN, "joint_2", "joint_1", "gripper", "joint_3")
    for k in range(4):
        turn = 0.1 + k * 123.456789
        q = np.array([turn, Q[1], Q[0], 0.5, Q[2]])
        sent = cell.answer(command(q, names, T0_NS + k))
        assert list(sent.name) == list(EVERY)
        assert sent.header.frame_id == MARK
        np.testing.assert_array_equal(sent.position, [*plain, turn])
    assert cell.node._desk.path.counts["corrected"] == 5
    cell.states.publish(command(np.append(plain, 7.5), EVERY))
    assert bench.until(lambda: cell.nominal)
    assert list(cell.nominal[-1].name) == list(EVERY)
    np.testing.assert_allclose(cell.nominal[-1].position, [*Q, 7.5], atol=1e-12)
    cell.nominal.clear()
    cell.states.publish(command(plain, NAMES))
    assert bench.until(lambda: cell.nominal)
    assert list(cell.nominal[-1].name) == list(NAMES)


def test_without_compensation_it_is_the_same(bench: Bench, tmp_path: Path) -> None:
    cell = Cell(bench, robot=written(tmp_path, TURN))
    for k in range(2):
        sent = cell.answer(command(np.append(Q, -8.0), EVERY, T0_NS + k))
        assert (list(sent.name), sent.header.frame_id) == (list(EVERY), "")
        np.testing.assert_array_equal(sent.position, [*Q, -8.0])


def test_a_part_of_several_and_what_is_no_number_are_refused(bench: Bench, tmp_path: Path) -> None:
    cell = Cell(bench, robot=written(tmp_path, "turn", "grip"))
    part = command(np.append(Q, 1.0), (*NAMES, "grip"))
    assert cell.answer(part) is None
    assert cell.diagnosed("passed-through axes (turn, grip) are expected once each")
    both = (*NAMES, "grip", "turn")
    assert cell.answer(command(np.append(Q, [1.0, np.nan]), both)) is None
    assert cell.diagnosed("turn = nan; finite values are needed")
    sent = cell.answer(command(np.append(Q, [1.0, 2.0]), both))
    np.testing.assert_array_equal(sent.position, [*Q, 2.0, 1.0])  # in the order of the robot file


def planned(rows: np.ndarray, names: tuple[str, ...], uneven: bool) -> JointTrajectory:
    message = JointTrajectory(joint_names=list(names))
    for k, row in enumerate(rows):
        point = JointTrajectoryPoint(positions=array("d", row), velocities=array("d", 0.1 * row))
        if uneven:  # then it is read as a message, not as arrays
            point.effort = array("d", [0.0] * (k + 1))
        point.time_from_start = Duration(sec=k + 1)
        message.points.append(point)
    return message


@pytest.mark.parametrize("uneven", [False, True])
def test_trajectories_carry_it(bench: Bench, file: Path, tmp_path: Path, uneven: bool) -> None:
    cell = Cell(
        bench,
        robot=written(tmp_path, TURN),
        calibration=file,
        ramp_s=0.0,
        trajectory_controller="following",
        trajectory_input="planned",
    )
    out = heard(cell, JointTrajectory, "following/joint_trajectory")
    commander = cell.world.create_publisher(JointTrajectory, "planned", CONTROLLER)
    assert bench.until(commander.get_subscription_count)
    assert cell.call("enable", True)[0]
    names = ("joint_3", TURN, "joint_1", "joint_2")
    rows = np.array([[Q[2], 5.0, Q[0], Q[1]], [Q[2] + 0.01, 400.0, Q[0] + 0.01, Q[1] + 0.01]])
    commander.publish(planned(rows, names, uneven))
    assert bench.until(lambda: out)
    sent = out[-1]
    assert (list(sent.joint_names), sent.header.frame_id) == (list(EVERY), MARK)
    for point, row in zip(sent.points, rows, strict=True):
        assert point.positions[3] == row[1]
        assert point.velocities[3] == 0.1 * row[1]
        moved = np.abs(np.array(point.positions[:3]) - row[[2, 3, 0]])
        assert CLEARLY < moved.max() < 0.02
    commander.publish(planned(rows[:, [2, 3, 0]], NAMES, uneven))
    assert bench.until(lambda: len(out) == 2)
    assert list(out[-1].joint_names) == list(NAMES)
    np.testing.assert_array_equal(out[-1].points[1].positions, sent.points[1].positions[:3])


def test_a_controller_of_all_axes_gets_whole_commands_only(bench: Bench, tmp_path: Path) -> None:
    cell = Cell(
        bench,
        robot=written(tmp_path, TURN),
        command_controller="forward",
        command_joints=[TURN, *NAMES],
    )
    commands = heard(cell, Float64MultiArray, "forward/commands")
    assert cell.answer(command(np.append(Q, 3.0), EVERY)) is not None
    assert bench.until(lambda: commands)
    np.testing.assert_array_equal(commands[-1].data, [3.0, *Q])
    assert cell.give(Q, T0_NS + 1) is not None
    assert cell.diagnosed("forward: a command without joint_4 is not sent")
    assert len(commands) == 1
