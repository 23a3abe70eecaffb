"""The positioner and the simulated tracker as processes: points are corrected, and it ends."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from delta_calibration.errors import InputError, ReachError
from delta_calibration.plans import nominal_joints
from delta_calibration.robot import load_robot
from delta_calibration.ros.grid_positioner import GridPositioner
from delta_calibration.ros.qos import COMMAND, STREAM_OUT
from ros_helpers import Bench, Launch, bench_fixture, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros

NODES = "delta_calibration.ros"
ROBOT = load_robot("srbd")
TARGETS = np.array([[0.15, -0.1, -0.72]])  # [m]


@pytest.fixture
def points(tmp_path: Path) -> Path:
    path = tmp_path / "points.csv"
    np.savetxt(path, 1e3 * TARGETS, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    return path


@pytest.mark.slow
def test_points_are_driven_right_and_it_ends(launch: Launch, points: Path, tmp_path: Path) -> None:
    table = tmp_path / "corrections.csv"
    # without a calibration node the drives receive the nominal commands
    to_drives = ("--ros-args", "-r", "joint_command:=joint_command_compensated")
    cell = launch(f"{NODES}.simulated_tracker", seed=4, rate=200.0)
    node = launch(
        f"{NODES}.grid_positioner",
        *to_drives,
        points=points,
        output=table,
        frame_stops=5,
        repeats=2,
        readings=5,
        dwell=0.12,
        rate=100.0,
    )
    assert node.end(50.0) == 0, node.output
    assert "tracker frame from 5 stops" in node.output
    assert "point 1: " in node.output
    assert cell.process.poll() is None

    rows = list(csv.DictReader(table.read_text().splitlines()))
    nominal = nominal_joints(ROBOT, TARGETS)
    assert len(rows) == len(TARGETS)
    for row, target, command in zip(rows, TARGETS, nominal, strict=True):
        columns = [
            [float(row[f"{kind}{n}"]) for n in ROBOT.joints.names]
            for kind in ("", "correction_", "std_")
        ]
        joint, correction, std = np.array(columns)
        place = [float(row[name]) for name in ("x_mm", "y_mm", "z_mm")]
        np.testing.assert_allclose(place, 1e3 * target, atol=1e-5)
        np.testing.assert_allclose(joint - correction, command, atol=2e-9)
        assert np.all(std >= np.radians(0.01) / np.sqrt(12) - 1e-9)
        assert float(row["before_mm"]) > 0.15
        assert float(row["after_mm"]) < 0.1
        assert 4 < int(row["moves"]) < 40
        assert row["ended"] == "one command unit reached"


def test_a_silent_tracker_is_named(launch: Launch, bench: Bench, points: Path) -> None:
    """A cell that follows the commands and publishes its joints, without a tracker."""
    cell = bench.node("cell")
    states = cell.create_publisher(JointState, "joint_states", STREAM_OUT)
    last = JointState(name=list(ROBOT.joints.names), position=[0.0, 0.1, 0.2])

    def follow(message: JointState) -> None:
        last.position = message.position

    cell.create_subscription(JointState, "joint_command", follow, COMMAND)
    cell.create_timer(0.02, lambda: states.publish(last))
    node = launch(f"{NODES}.grid_positioner", points=points, patience=1.0)
    assert bench.until(lambda: node.process.poll() is not None, 30.0)
    assert node.end() == 1
    assert "sets off: tracker frame, stop 1 of 24" in node.output
    assert "tracker frame, stop 1 of 24: not measured in 1 s: no tracker readings" in node.output


def test_nobody_listens(launch: Launch, points: Path) -> None:
    node = launch(f"{NODES}.grid_positioner", points=points, wait_for_subscriber=0.3)
    assert node.end() == 1
    assert (
        "did not begin within 0.3 s: nobody listens to /joint_command, no joint_states were "
        "received; " in node.output
    )
    assert "calibration_node: are it and the machine" in node.output
    assert len(node.output.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "value", "error", "said"),
    [
        ("points", "", InputError, "parameter points: needed"),
        ("points", "/no/such.csv", InputError, "/no/such.csv: cannot be read"),
        ("points", "far.csv", ReachError, "point 1"),
        ("repeats", 1, InputError, "repeats"),
        ("largest_deg", 0.1, InputError, "the first lattice alone needs 16 command units"),
        ("calibration", "/no/such.yaml", InputError, "/no/such.yaml"),
    ],
)
def test_wrong_parameters_are_refused(
    bench: Bench,
    tmp_path: Path,
    points: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    value: object,
    error: type[Exception],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("far.csv").write_text("x_mm,y_mm,z_mm\n5000,0,-711\n")
    given = {"points": str(points), name: value}
    overrides = [Parameter(key, value=entry) for key, entry in given.items()]
    with pytest.raises(error, match=said):
        GridPositioner(context=bench.context, parameter_overrides=overrides)
