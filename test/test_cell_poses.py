"""Tests of a cell's desk with simulated machines of all robots: capture, fit, compensate."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session, standing

pytest.importorskip("rclpy")
from delta_calibration.ros.simulated_machine import SimulatedMachine, without_noise

ROBOTS = ("five_axis", "linear_delta", "scara", "ur10")


@pytest.mark.parametrize("name", ROBOTS)
def test_a_cell_is_captured_fitted_and_compensated(name: str) -> None:
    desk = CalibrationSession(Settings(robot=name, ramp_s=0.0, rate=100.0))
    machine = draw_machine(desk.robot, 5)
    plan = make_plan("identify", desk.robot, count=24, dwell=0.4, both_sides=False, seed=5)
    session = simulate_session(machine, plan, 5)
    desk.start_capture(0.0)
    for stream, add in (
        (session.command, desk.capture.add_command),
        (session.states, desk.capture.add_states),
    ):
        for stamp, position in zip(stream.stamp_ns.tolist(), stream.position, strict=True):
            add(stamp, position)
    for stamp, position in zip(
        session.tracker.stamp_ns.tolist(), session.tracker.position, strict=True
    ):
        desk.capture.add_tracker(stamp, position)
    desk.stop_capture()
    assert "24 poses" in desk.take(*desk.prepare_fit()())
    desk.enable(True)
    sent = [desk.send(q, k + 1, 1.0 + k, False) for k, q in enumerate(plan.joint)]
    joint = np.array([command.joint for command in sent])
    corrected = (joint != plan.joint).any(axis=1)
    assert corrected.sum() >= 8  # places in or near the measured region

    def off(q: np.ndarray) -> np.ndarray:
        """Distance of the tool from the targets in the calibration's base, (n,) [m]."""
        seen = desk.calibration.tool_points(machine.reflector_points(standing(q)), q)
        gap = (seen - plan.target)[corrected]
        return np.linalg.norm(gap[:, : desk.robot.commanded.task_size], axis=1)

    assert np.median(off(joint)) < 0.2 * np.median(off(plan.joint))
    upstream = desk.nominal(joint[-1], 1.0 + len(joint))
    np.testing.assert_allclose(upstream, plan.joint[-1], atol=1e-9)


@pytest.mark.parametrize("name", [*ROBOTS, "cdpr8"])
def test_the_simulated_machine_goes_where_it_is_told(name: str) -> None:
    machine = draw_machine(without_noise(load_robot(name)), 5)
    cell = SimulatedMachine(machine, np.random.default_rng(1), 0.0)
    joint = make_plan("identify", machine.robot, count=1, both_sides=False).joint[0]
    cell.command(joint, 1.0)
    seen = cell.measure(2.0)
    np.testing.assert_array_equal(seen.joint, joint)
    true = machine.reflector_points(standing(joint[None]))[0]
    np.testing.assert_allclose(seen.position, true, atol=1e-9)
    assert np.linalg.norm(seen.quaternion) == pytest.approx(1.0)
