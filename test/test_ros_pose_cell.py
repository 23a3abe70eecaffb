"""A robot with eight cables and pose commands is measured, fitted, compensated and improves."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from delta_calibration.data import Poses, collect
from delta_calibration.geometry.frames import align
from delta_calibration.plans import Targets, read_targets
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot
from ros_helpers import Launch, launch_fixture  # noqa: F401

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NODES = "delta_calibration.ros"
PATIENCE_S = 60.0
ROBOT = load_robot("cdpr8")
FILE = Path(ROBOT.source)
PLACES = [  # [mm]
    [-170.0, -140.0, 1150.0],
    [170.0, 140.0, 1150.0],
    [170.0, -140.0, 1350.0],
    [-170.0, 140.0, 1350.0],
    [0.0, 0.0, 1250.0],
]
TURN = (3.0, -2.0, 4.0)  # [deg] constant, so the unknown reflector offset is one shift


def test_cables_are_measured_fitted_and_compensated(launch: Launch, tmp_path: Path) -> None:
    corners, session = tmp_path / "corners.csv", tmp_path / "session"
    rows = np.hstack([PLACES, np.tile(TURN, (len(PLACES), 1))])
    head = "x_mm,y_mm,z_mm,turn_x_deg,turn_y_deg,turn_z_deg"
    np.savetxt(corners, rows, delimiter=",", header=head, comments="")
    robot = tmp_path / "cdpr8.yaml"  # a smaller workspace makes this shorter
    robot.write_text(FILE.read_text().replace("[1600.0, 1200.0, 800.0]", "[700.0, 600.0, 400.0]"))
    recorder = launch(f"{NODES}.session_recorder", output=session)
    launch(f"{NODES}.simulated_tracker", robot=robot, seed=17)
    launch(f"{NODES}.calibration_node", robot=robot, autostart=True, ramp_s=0.0)

    def call(*arguments: str) -> str:
        caller = launch(f"{NODES}.trigger", *arguments, str(PATIENCE_S))
        assert caller.end(PATIENCE_S) == 0, caller.output
        return caller.output

    def measure(plan: object, **more: object) -> None:
        given = {"robot": robot, "dwell": 0.8, "rate": 25.0, "both_sides": False, **more}
        node = launch(f"{NODES}.measurement_plan", plan=plan, subscribers=2, **given)
        assert node.end(PATIENCE_S) == 0, node.output

    call("/calibration_node/start_capture")
    measure("identify", count=14)
    measure(corners)
    assert "poses, rank" in call("/calibration_node/fit")
    call("/calibration_node/enable", "true")
    measure(corners)
    recorder.send(signal.SIGINT)
    assert recorder.end() == 0, recorder.output

    poses = collect(read_session(session), ROBOT.joints.names)
    targets = read_targets(corners, ROBOT)
    before, after = (shape_error(poses, targets, corrected) for corrected in (False, True))
    assert before.mean() > 0.5e-3
    assert after.mean() < 0.1 * before.mean()


def shape_error(poses: Poses, targets: Targets, corrected: bool) -> np.ndarray:
    """Distance of the measured tool from the targets, (n,) [m].

    For uncorrected or for corrected commands, which the encoders show. The tracker frame is the
    best-fit one, so the calibration has no influence.
    """
    there = np.abs(poses.joint - poses.command).max(axis=1) > 1e-2  # [rad] motors stop within 1e-3
    points = []
    for joint in targets.joint:
        meant = np.abs(poses.command - joint).max(axis=1) < 1e-3
        points.append(poses.point[np.flatnonzero(meant & (there == corrected))[-1]])
    seen = np.array(points)
    return np.linalg.norm(align(seen, targets.point).apply(seen) - targets.point, axis=1)
