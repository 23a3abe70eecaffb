"""What the launch file starts, on real nodes: parameters as declared, a cell that stands up."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
from sensor_msgs.msg import JointState

from delta_calibration.ros.calibration_parameters import SPECS
from delta_calibration.ros.lifecycle import AUTOSTART
from launch_stand_in import LaunchDescription, load
from ros_helpers import Bench, Launch, bench_fixture, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros

FILE = Path(__file__).parents[1] / "launch" / "cell.launch.py"
PACKAGE = "delta_calibration"
PATIENCE_S = 120.0  # four processes import at once
EVERYTHING = {"record": "true", "plan": "line", "foxglove": "true", "calibration": "cell.yaml"}


@pytest.fixture(name="cell", scope="module")
def cell_fixture() -> LaunchDescription:
    return load(FILE)


def test_parameters_are_declared_by_the_nodes_and_allowed(cell: LaunchDescription) -> None:
    every = cell.started(**EVERYTHING) | cell.started(play="session_1")
    for executable, (node, values) in every.items():
        if node.package != PACKAGE:
            continue
        module = importlib.import_module(f"{PACKAGE}.ros.{executable}")
        own = (*SPECS, AUTOSTART) if executable == "calibration_node" else module.SPECS
        known = {spec.name: spec for spec in own}
        assert set(values) <= set(known), executable
        for name, value in values.items():
            default = known[name].default
            wanted = list if isinstance(default, tuple) else type(default)
            assert type(value) is wanted, (executable, name)
            assert known[name].reason_against(value) is None, (executable, name)


@pytest.mark.slow
def test_a_cell_stands_up_as_launched(
    cell: LaunchDescription, launch: Launch, bench: Bench, tmp_path: Path
) -> None:
    """The package's own nodes with these parameters, as processes: joints move, links are told."""
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
    assert len(heard[-1].name) == 3 + 18
    assert nodes["calibration_node"].says("configured for srbd", PATIENCE_S)
    assert all(process.process.poll() is None for process in nodes.values())
