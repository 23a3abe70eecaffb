"""Nodes as started by the launch file: declared parameters, and a cell that starts."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from delta_calibration.ros.conversions import joint_state
from delta_calibration.ros.node_help import specs_of
from delta_calibration.ros.qos import BY_NAME, COMMAND, MEASURED, STATUS, STREAM_OUT
from launch_stand_in import LaunchDescription, load
from ros_helpers import Bench, Launch, bench_fixture, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros

FILE = Path(__file__).parents[1] / "launch" / "cell.launch.py"
PACKAGE = "delta_calibration"
PATIENCE_S = 120.0  # four processes start at the same time
EVERYTHING = {"record": "true", "plan": "line", "foxglove": "true", "calibration": "cell.yaml"}
CHOSEN = {"method": "apso", "on_failure": "hold", "command_timeout_s": "1", "namespace": "left"}


@pytest.fixture(name="cell", scope="module")
def cell_fixture() -> LaunchDescription:
    return load(FILE)


def test_parameters_are_declared_by_the_nodes_and_allowed(cell: LaunchDescription) -> None:
    every = cell.started(**EVERYTHING, **CHOSEN) | cell.started(play="session_1")
    for executable, (node, values) in every.items():
        if node.package != PACKAGE:
            continue
        known = {spec.name: spec for spec in specs_of(executable)}
        assert set(values) <= set(known), executable
        for name, value in values.items():
            default = known[name].default
            wanted = list if isinstance(default, tuple) else type(default)
            assert type(value) is wanted, (executable, name)
            assert known[name].reason_against(value) is None, (executable, name)


class Side:
    """One of two robots, and the messages received from it."""

    def __init__(self, bench: Bench, name: str) -> None:
        node = bench.node(f"{name}_watcher", namespace=name)
        self.command = node.create_publisher(JointState, "joint_command", STREAM_OUT)
        self.sent: list[JointState] = []
        self.states: list[JointState] = []
        self.frames: dict[str, set[str]] = {"tracker/pose": set(), "cell/payload": set()}
        self.pictures: list[MarkerArray] = []
        node.create_subscription(
            JointState, "joint_command_compensated", self.sent.append, COMMAND
        )
        node.create_subscription(JointState, "joint_states", self.states.append, MEASURED)
        for topic, frames in self.frames.items():
            known = BY_NAME[topic]
            node.create_subscription(
                known.message, topic, partial(self._note, frames), known.reader
            )
        picture = "calibration_node/markers"
        node.create_subscription(MarkerArray, picture, self.pictures.append, STATUS)

    @staticmethod
    def _note(frames: set[str], message: Any) -> None:
        frames.add(message.header.frame_id)

    def is_up(self) -> bool:
        """Whether both nodes are running and all topics have been received."""
        return bool(
            self.pictures
            and all(self.frames.values())
            and self.states
            and self.command.get_subscription_count()
        )


@pytest.mark.slow
def test_two_robots_in_two_namespaces_do_not_hear_each_other(
    cell: LaunchDescription, launch: Launch, bench: Bench, tmp_path: Path
) -> None:
    sides = {name: Side(bench, name) for name in ("left", "right")}
    nodes = []
    for name in sides:
        started = cell.started(namespace=name, rviz="false", output=str(tmp_path / name))
        for executable in ("calibration_node", "simulated_tracker"):
            node, values = started[executable]
            space = ("--ros-args", "-r", f"__ns:=/{node.namespace}", "--")
            nodes.append(launch(f"{PACKAGE}.ros.{executable}", *space, **values))
    everything_up = bench.until(lambda: all(s.is_up() for s in sides.values()), PATIENCE_S)
    assert everything_up, [node.output for node in nodes]
    for name, side in sides.items():
        assert side.frames == {
            "tracker/pose": {f"{name}/tracker"},
            "cell/payload": {f"{name}/tool0"},
        }
        drawn = {marker.header.frame_id for m in side.pictures for marker in m.markers}
        assert drawn == {f"{name}/base_link"}
    left, right = sides["left"], sides["right"]
    bench.spin_for(0.5)  # the other side has to discover the publisher too
    home = np.array(left.states[-1].position)
    goal = home + 0.05

    def moved() -> bool:
        last = left.states[-1]
        left.command.publish(joint_state(last.name, goal, last.header.stamp))
        bench.spin_for(0.02)
        return bool(np.abs(np.array(left.states[-1].position) - goal).max() < 1e-3)

    assert bench.until(moved)
    bench.spin_for(0.2)
    assert left.sent
    assert right.sent == []
    assert np.abs(np.array(right.states[-1].position) - home).max() < 1e-3


def test_a_file_of_parameters_is_read_in_every_namespace_and_what_is_named_goes_before(
    launch: Launch, tmp_path: Path
) -> None:
    """Launch passes both to a node, the file first."""
    file = tmp_path / "cell.yaml"
    parameters = "  ros__parameters:\n    robot: no_such_robot\n"
    file.write_text(f"/**/robot_description:\n{parameters}")
    node_name = f"{PACKAGE}.ros.robot_description"
    for space, named, said in (
        ("/", (), "no_such_robot"),
        ("/left", ("-p", "robot:=nor_this"), "nor_this"),
    ):
        file_first = ("--params-file", str(file), *named)
        node = launch(node_name, "--ros-args", "-r", f"__ns:={space}", *file_first)
        assert node.end() == 2
        assert said in node.output


@pytest.mark.slow
def test_a_cell_stands_up_as_launched(
    cell: LaunchDescription, launch: Launch, bench: Bench, tmp_path: Path
) -> None:
    """The nodes of this package as processes: joints move, and passive joints are published."""
    chosen = {"rviz": "false", "record": "true", "session": str(tmp_path / "session")}
    nodes = {
        executable: launch(f"{PACKAGE}.ros.{executable}", **values)
        for executable, (node, values) in cell.started(**chosen).items()
        if node.package == PACKAGE
    }
    recorded = {"simulated_tracker", "session_recorder"}
    assert set(nodes) == {"calibration_node", "robot_description"} | recorded
    heard: list[JointState] = []
    node = bench.node("viewer")
    node.create_subscription(JointState, "joint_states_all", heard.append, 100)
    said = {executable: process.output for executable, process in nodes.items()}
    assert bench.until(lambda: len(heard) > 20, PATIENCE_S), said
    assert len(heard[-1].name) == 3 + 21
    assert nodes["calibration_node"].says("configured for srbd", PATIENCE_S)
    assert all(process.process.poll() is None for process in nodes.values())
