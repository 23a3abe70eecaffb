"""A pose far off all others is set aside: it does not hide in the noise nor refuse the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

OFF = np.array([8e-3, -3e-3, 11e-3])  # [m] about the distance to the next nest of a reflector


@pytest.fixture(scope="module", params=["srbd", "scara", "five_axis", "ur10", "cdpr8"])
def machine(request):
    """A robot, a session of it, and the fit to that session."""
    robot = load_robot(request.param)
    session = simulate_session(draw_machine(robot, 3), make_plan("identify", robot, seed=3), 3)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    return robot, seen, calibrated(seen, robot)


@pytest.mark.parametrize("row", [0, 4, 36, 90, 112])
def test_a_gross_error_at_any_pose_is_found_as_one(machine, row):
    """The first and the last poses have most leverage on what the conditions may explain."""
    robot, seen, clean = machine
    point = seen.poses.point.copy()
    point[row] += OFF
    found = calibrated(replace(seen, poses=replace(seen.poses, point=point)), robot)
    assert found.floor == pytest.approx(clean.floor, rel=0.1)
    np.testing.assert_array_equal(np.flatnonzero(found.cell.weight == 0), [row])
