"""Motion updated with each command, compared with whole streams and known functions."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.data import motion_of
from delta_calibration.plans import legs, make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import Following

START = np.array([0.1, -0.2, 0.3])
SPEED = np.array([0.5, 0.0, -0.2])
CURVE = np.array([1.0, -2.0, 0.0])


def followed(time, joint):
    following = Following.standing(joint[0])
    for when, angles in zip(time.tolist(), joint, strict=True):
        following = following.moved(angles, when)
    return following


@pytest.mark.parametrize("rate", [10.0, 50.0, 1000.0])
def test_a_parabola_is_followed_exactly(rate):
    time = 1.7e9 + np.arange(int(0.3 * rate) + 1) / rate
    t = (time - time[-1])[:, None]
    velocity, acceleration = followed(time, START + SPEED * t + CURVE * t**2 / 2).derivatives()
    np.testing.assert_allclose(velocity, SPEED, atol=1e-4)  # stamps are accurate to 0.2 us
    np.testing.assert_allclose(acceleration, CURVE, atol=5e-3)


def test_joints_that_are_told_the_same_again_stand_still():
    time = np.arange(10) / 50.0
    moving = START + SPEED * time[:, None]
    following = followed(time, moving)
    assert following.derivatives()[0][0] == pytest.approx(0.5)
    for state in (following.stopped(), following.moved(moving[-1], time[-1] + 0.02)):
        assert not np.any(state.derivatives())
        np.testing.assert_array_equal(state.direction(), following.direction())
        np.testing.assert_array_equal(state.travel(START), following.travel(START))


@pytest.mark.parametrize("later", [0.0, -1.0, 0.3])
def test_across_a_pause_or_a_clock_that_stands_there_is_no_speed(later):
    time = np.arange(10) / 50.0
    following = followed(time, START + SPEED * time[:, None])
    assert not np.any(following.moved(START + 1.0, time[-1] + later).derivatives())


def test_directions_and_travel_are_those_of_the_whole_stream():
    robot = load_robot("srbd")
    plan = make_plan("disc", robot, count=6, dwell=0.2)
    joint = np.concatenate([leg.joint for leg in legs(plan, robot, 50.0)])
    time = np.arange(len(joint)) / 50.0
    whole = motion_of(time, joint)
    following = Following.standing(joint[0])
    turned = 0
    for row, angles in enumerate(joint):
        following = following.moved(angles, float(time[row]))
        np.testing.assert_array_equal(following.direction(), whole.direction[row])
        np.testing.assert_array_equal(following.travel(angles), whole.travel[row])
        turned += np.isfinite(following.travel(angles)).all()
    assert turned > len(joint) / 2


def test_play_turns_with_the_command_and_not_when_a_turn_is_sure():
    """A stream shows a reversal only beyond the noise, but the machine has reversed before."""
    back = np.array([0.0, 0.1, 0.1 - 50e-6])[:, None] * np.ones(3)
    following = followed(np.arange(3) * 0.05, back)
    np.testing.assert_array_equal(following.direction(), -np.ones(3))
    np.testing.assert_allclose(following.travel(back[-1]), 50e-6, atol=1e-15)
