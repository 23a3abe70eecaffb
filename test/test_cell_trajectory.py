"""Tests of trajectories point by point: corrections, ramps, velocities, policy, feedback."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.cell import command_path, trajectory
from delta_calibration.cell.command_path import HOLD, PASS_THROUGH, CommandPath
from delta_calibration.cell.surroundings import Surroundings
from delta_calibration.cell.trajectory import Points, TrajectoryPath
from delta_calibration.compensation import CommandStatus, Compensated, JointCompensator
from delta_calibration.data import Conditions
from delta_calibration.errors import DataError
from six_rods import drawing_joints
from test_cell_command_path import DQ, GAP, Fixed, Q, Sided, compensating, outside
from test_compensator import calibration, errors

TIME = np.array([1.0, 2.0, 4.0])


class EachSide(Sided):
    """Corrects many commands, each by its own side."""

    def compensate(self, q: np.ndarray, at: Conditions | None = None) -> Compensated:
        assert at is not None
        rows = [slice(k, k + 1) for k in range(len(q))]
        each = [super(EachSide, self).compensate(q[r], at.take(r)) for r in rows]
        return Compensated.joined(each)


def points(q: np.ndarray = Q, time: np.ndarray = TIME) -> Points:
    return Points(time, np.tile(q, (len(time), 1)))


def test_without_compensation_a_trajectory_goes_out_as_it_came() -> None:
    path = CommandPath()
    sent = TrajectoryPath(path).send(points(), 0.0)
    np.testing.assert_array_equal(sent.joint, points().joint)
    assert not sent.compensated
    assert path.counts[command_path.PASSED] == 3


def test_corrections_come_over_the_ramp_at_the_times_of_the_points() -> None:
    path = compensating(ramp_s=2.0)
    trajectories = TrajectoryPath(path)
    sent = trajectories.send(points(time=np.array([1.0, 2.0, 3.0, 5.0])), 0.0)
    np.testing.assert_allclose((sent.joint - Q)[:, 0] / DQ[0], [0.0, 0.5, 1.0, 1.0])
    assert sent.compensated
    for now_s, share in ((0.5, 0.0), (1.5, 0.25), (3.0, 1.0)):  # progress by that time
        trajectories.settle(now_s)
        np.testing.assert_allclose(path.nominal(Q), Q - share * DQ, atol=1e-15)


def test_a_trajectory_before_the_last_has_ended_begins_at_the_correction_of_that_moment() -> None:
    path = compensating(ramp_s=2.0)
    trajectories = TrajectoryPath(path)
    trajectories.send(points(time=np.array([0.0, 2.0])), 0.0)
    path.enable(False)
    sent = trajectories.send(points(time=np.array([1.0, 2.0, 3.0])), 1.0)
    np.testing.assert_allclose((sent.joint - Q)[:, 0] / DQ[0], [0.5, 0.25, 0.0], atol=1e-12)


def test_the_rate_holds_between_points_and_is_counted() -> None:
    path = CommandPath(ramp_s=0.0, rate=0.005)
    path.load(Fixed())
    path.enable(True)
    path.send(Q - 0.1, 0, 0.0)
    path.load(Fixed(-DQ))
    sent = TrajectoryPath(path).send(points(), 0.0)
    np.testing.assert_allclose((sent.joint - Q)[:, 1], [-0.015, -0.01, 0.0], atol=1e-12)
    assert path.counts[command_path.LIMITED] == 3


def test_a_point_that_fails_a_guard_passes_or_refuses_the_whole() -> None:
    joint = np.array([Q, outside(), Q])
    passing = TrajectoryPath(path := compensating(PASS_THROUGH))
    sent = passing.send(Points(TIME, joint), 0.0)
    np.testing.assert_allclose(sent.joint - joint, [DQ, 0 * DQ, DQ])
    assert path.counts[CommandStatus.OUTSIDE_REGION.value] == 1
    assert path.trouble == f"point 1: {CommandStatus.OUTSIDE_REGION.value}"
    holding = TrajectoryPath(path := compensating(HOLD))
    with pytest.raises(DataError, match="point 1: outside the calibrated region"):
        holding.send(Points(TIME, joint), 0.0)
    assert path.counts[trajectory.REFUSED] == 1
    np.testing.assert_array_equal(path.nominal(Q), Q)  # nothing was sent


def test_a_marked_trajectory_is_not_corrected_again() -> None:
    path = compensating()
    sent = TrajectoryPath(path).send(points(), 0.0, already=True)
    np.testing.assert_array_equal(sent.joint, points().joint)
    assert path.counts[command_path.ALREADY] == 1


def test_velocities_bend_with_the_correction() -> None:
    """The velocities sent are the derivative of the corrected path."""
    path = CommandPath(ramp_s=0.0)
    path.load(JointCompensator(calibration(errors(np.random.default_rng(2)))))
    path.enable(True)
    time = np.linspace(0.0, 1.0, 2001)
    x = np.stack([0.2 * np.sin(2 * time), 0.1 * np.cos(3 * time), -0.7 + 0 * time], axis=1)
    q = drawing_joints(x)
    velocity = np.gradient(q, time, axis=0)
    sent = TrajectoryPath(path).send(Points(time, q, velocity), 0.0)
    np.testing.assert_allclose(
        sent.velocity[5:-5], np.gradient(sent.joint, time, axis=0)[5:-5], atol=2e-6
    )
    assert np.abs(sent.velocity - velocity).max() > 1e-4
    still = TrajectoryPath(path).send(Points(TIME, q[:3], np.zeros((3, 3))), 0.0)
    np.testing.assert_array_equal(still.velocity, 0.0)


def test_points_are_judged_by_the_motion_that_they_stand_for_and_leave_no_trace() -> None:
    path = CommandPath(ramp_s=0.0)
    path.load(EachSide())
    path.enable(True)
    around = Surroundings(3)
    around.moved(Q, 0)
    joint = Q + np.array([0.1, 0.2, 0.1])[:, None]

    sent = TrajectoryPath(path).send(Points(TIME, joint), 0.0, around=around)
    side = np.array([1.0, 1.0, -1.0])[:, None] * np.ones(3)
    np.testing.assert_allclose(sent.joint - joint, GAP / 2 * side)
    np.testing.assert_array_equal(around.at(Q, 0.0).direction, 0.0)


@pytest.mark.parametrize("beyond_limits", ["refuse", "clamp"])
def test_a_trajectory_beyond_a_limit_is_refused_or_brought_to_it(beyond_limits: str) -> None:
    limits = Q - 1.0, Q + 0.05
    path = CommandPath(limits=limits, beyond_limits=beyond_limits)
    one = points()
    far = replace(one, joint=one.joint + np.array([0.0, 0.3, 0.0]))
    if beyond_limits == "refuse":
        with pytest.raises(DataError, match="beyond a joint limit"):
            TrajectoryPath(path).send(far, 0.0)
        assert path.counts[command_path.BEYOND] == 1
        return
    sent = TrajectoryPath(path).send(far, 0.0).joint
    np.testing.assert_array_equal(sent, np.clip(far.joint, *limits))
    assert path.counts[command_path.CLAMPED] == 1
