"""The third term of the series of a delay, left out of its law, widens the stated interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import at_rest
from delta_calibration.effects import effect_named
from delta_calibration.effects.signals import recorded
from delta_calibration.robot import load_robot

SPEEDS, LATE, RATE = np.array([2.0, 3.0, 5.0]), 0.02, 50.0  # [rad/s], [s], [1/s]
TIMES = np.concatenate([np.arange(0, 4, 1 / RATE), 100 + np.arange(0, 4, 1 / RATE)])


def waves(time, derivative=0):
    """Three waves of one amplitude, or a derivative of them, (n, 3)."""
    turn = SPEEDS * np.asarray(time)[:, None] + derivative * np.pi / 2
    return 0.1 * SPEEDS**derivative * np.sin(turn)


@pytest.fixture(scope="module")
def at():
    order = np.random.default_rng(0).permutation(len(TIMES))
    blank = at_rest(waves(TIMES))
    moving = replace(
        blank,
        time=TIMES,
        velocity=waves(TIMES, 1),
        acceleration=waves(TIMES, 2),
        reading=waves(TIMES),
        reading_velocity=waves(TIMES, 1),
        reading_acceleration=waves(TIMES, 2),
    )
    return moving.take(order)


@pytest.mark.parametrize(
    ("cause", "count", "second", "third"),
    [
        ("timestamp_latency", 1, 0.5, 1 / 6),
        ("joint_lag", 3, 1.0, 1.0),
        ("joint_lag", 3, 0.0, 0.0),
    ],
)
def test_it_is_that_of_the_series(at, cause, count, second, third):
    """y(t - T) has 1/6 of the third derivative, a filter of first order all of it."""
    robot = load_robot("srbd")
    effect = effect_named(cause, robot, robot.model(), {})
    doubt = replace(effect, second_order=second, times=(LATE,) * count).doubt()
    columns = doubt.columns_of(recorded(robot.model(), at))
    wanted = third * LATE**2 * waves(at.time, 3)
    inside = (at.time % 100 > 1 / RATE) & (at.time % 100 < 4 - 2 / RATE)
    found = columns[inside].sum(axis=2)
    limit = 0.01 * np.abs(third * LATE**2 * waves(at.time, 3)).max() + 1e-15
    np.testing.assert_allclose(found, wanted[inside], atol=limit)


def test_what_is_left_out_bends_the_time_as_far_as_it_says(at):
    """The law fitted by least squares to exact delays of 20 ms is off by about the doubt."""
    robot = load_robot("srbd")
    effect = effect_named("timestamp_latency", robot, robot.model(), {})
    effect = replace(effect, second_order=0.5, times=(LATE,))
    late = waves(at.time - LATE) - waves(at.time)
    column = (-waves(at.time, 1) + 0.5 * LATE * waves(at.time, 2)).ravel()
    found = float(column @ late.ravel() / (column @ column))
    doubt = effect.doubt().columns_of(recorded(robot.model(), at))[:, :, 0].ravel()
    moved = abs(float(column @ doubt / (column @ column))) * found
    assert 0.5 * moved < abs(found - LATE) < 1.2 * moved
