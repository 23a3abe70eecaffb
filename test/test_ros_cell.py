"""A cell of processes is measured, fitted and compensated, becomes more accurate, and ends."""

from __future__ import annotations

import signal
from itertools import product
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from delta_calibration.data import Poses, collect
from delta_calibration.geometry.frames import align
from delta_calibration.plans import nominal_joints
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot
from ros_helpers import Launch, NodeProcess, launch_fixture  # noqa: F401

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NODES = "delta_calibration.ros"
PATIENCE_S = 60.0
ROBOT = load_robot("srbd")
CORNERS = np.array(list(product((-0.22, 0.22), (-0.22, 0.22), (-0.691, -0.811))))  # [m]


def test_a_cell_measures_itself_and_gets_better(launch: Launch, tmp_path: Path) -> None:
    robot = tmp_path / "srbd.yaml"  # processes of this test are recognised by this path
    robot.write_text(Path(ROBOT.source).read_text())
    corners = tmp_path / "corners.csv"
    np.savetxt(corners, CORNERS * 1e3, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    session = tmp_path / "session"
    cell = [
        launch(f"{NODES}.session_recorder", output=session),
        launch(f"{NODES}.simulated_tracker", robot=robot, seed=17),
        launch(f"{NODES}.calibration_node", robot=robot, autostart=True, ramp_s=0.0),
    ]

    def call(*arguments: str) -> str:
        caller = launch(f"{NODES}.trigger", *arguments, str(PATIENCE_S))
        assert caller.end(PATIENCE_S) == 0, caller.output
        return caller.output

    def measure(**parameters: object) -> None:
        plan = {"robot": robot, "dwell": 0.6, "both_sides": False, "subscribers": 2, **parameters}
        node = launch(f"{NODES}.measurement_plan", **plan)
        assert node.end(PATIENCE_S) == 0, node.output

    call("/calibration_node/start_capture")
    measure(plan="identify", count=12, both_sides=True)
    measure(plan=corners)
    call("/calibration_node/fit")
    assert call("/calibration_node/enable", "true").strip()
    measure(plan=corners)
    last = launch(f"{NODES}.measurement_plan", robot=robot)  # interrupted before its end
    assert last.says("1 of ")
    end_all([*cell, last])
    assert processes_with(str(tmp_path)) == []

    poses = collect(read_session(session), ROBOT.joints.names)
    error_before, error_after = shape_error(poses, 0), shape_error(poses, -1)
    assert error_before.mean() > 500e-6
    assert error_after.max() < 100e-6
    assert error_after.mean() < 0.1 * error_before.mean()


def end_all(nodes: list[NodeProcess]) -> None:
    """Send Ctrl-C to all nodes; each must end with 0 and without a traceback."""
    for node in nodes:
        assert node.process.poll() is None, node.output
        node.send(signal.SIGINT)
    for node in nodes:
        assert node.end() == 0, node.output
        assert "Traceback" not in node.output


def processes_with(text: str) -> list[str]:
    """Command lines of running processes that contain the text."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = entry.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:  # the process has just ended
            continue
        if text in line:
            found.append(line)
    return found


def shape_error(poses: Poses, visit: int) -> np.ndarray:
    """Distances of the measured corners from their targets, (n,) [m].

    Each corner counts at its first visit (0) or its last (-1). The tracker frame is aligned with
    the targets by the best rigid motion, so the calibration has no influence.
    """
    points = []
    for joint in nominal_joints(ROBOT, CORNERS):
        stops = np.flatnonzero(np.abs(poses.command - joint).max(axis=1) < 1e-4)
        assert len(stops) >= 2
        points.append(poses.point[stops[visit]])
    seen = np.array(points)
    return np.linalg.norm(align(seen, CORNERS).apply(seen) - CORNERS, axis=1)
