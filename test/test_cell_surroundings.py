"""Tests of the conditions of a live command: motion from the stream, payload, temperature."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.cell.surroundings import MOST_PARTS, Surroundings
from delta_calibration.data import motion_of
from delta_calibration.errors import InputError

MS = 1_000_000


def stream(around: Surroundings, time: np.ndarray, q: np.ndarray) -> None:
    for t, row in zip(time, q, strict=True):
        around.moved(row, round(t * 1e9))


def test_motion_is_that_of_the_whole_stream_seen_at_once() -> None:
    time = np.arange(0.0, 3.0, 0.001)
    q = 0.3 * np.sin(2.0 * time[:, None] + np.array([0.0, 1.0, 2.0]))
    around = Surroundings(3)
    stream(around, time, q)
    at, whole = around.at(q[-1], 0.0), motion_of(time, q)
    np.testing.assert_array_equal(at.direction[0], whole.direction[-1])
    np.testing.assert_allclose(at.travel[0], whole.travel[-1], atol=1e-12)
    rate = 0.6 * np.cos(2.0 * time[-1] + np.array([0.0, 1.0, 2.0]))
    # End error of a parabola over 0.1 s for a third derivative of 2.4 rad/s^3.
    np.testing.assert_allclose(at.velocity[0], rate, atol=2.4 * 0.1**2 / 6)
    np.testing.assert_allclose(at.acceleration[0], -4 * q[-1], atol=2.4 * 0.1)


def test_after_a_pause_the_joints_stand_but_their_play_stays_where_it_was() -> None:
    around = Surroundings(1)
    stream(around, np.array([0.0, 0.01, 0.02]), np.array([[0.0], [0.01], [0.02]]))
    assert around.at(np.array([0.02]), 0.0).velocity[0, 0] == pytest.approx(1.0)
    around.moved(np.array([0.02]), 5000 * MS)
    at = around.at(np.array([0.02]), 5.0)
    assert at.velocity[0, 0] == 0
    assert at.direction[0, 0] == 1


def test_stamps_that_do_not_rise_give_no_speed() -> None:
    around = Surroundings(1)
    for stamp in (10 * MS, 20 * MS, 20 * MS, 5 * MS):
        around.moved(np.array([stamp * 1e-9]), stamp)
        assert np.isfinite(around.at(np.array([0.0]), 0.0).velocity).all()
    assert around.at(np.array([0.0]), 0.0).velocity[0, 0] == 0


def test_what_was_never_heard_is_not_known_and_what_is_old_no_more() -> None:
    around = Surroundings(3, temperature_timeout_s=10.0)
    q = np.zeros(3)
    at = around.at(q, 0.0)
    assert np.isnan(at.payload).all()
    assert np.isnan(at.payload_centre).all()
    assert at.temperature_parts == ()
    assert at.temperature.shape == (1, 0)
    assert (at.direction == 0).all()
    around.carries(2.0, np.array([0.0, 0.0, -0.03]), 0.0)
    around.is_warm("base", 25.0, 5.0)
    around.is_warm("arm", 31.0, 0.0)
    at = around.at(q, 9.0)
    assert at.payload[0] == 2.0
    np.testing.assert_array_equal(at.payload_centre, [[0.0, 0.0, -0.03]])
    assert at.of_part("arm")[0] == 31.0
    at = around.at(q, 11.0)
    assert np.isnan(at.of_part("arm")[0])
    assert at.of_part("base")[0] == 25.0
    assert around.at(q, 1e9).payload[0] == 2.0  # sent once, and kept
    around.set_timeouts(20.0, 30.0)
    assert around.at(q, 11.0).of_part("arm")[0] == 31.0
    assert around.at(q, 29.0).payload[0] == 2.0
    assert np.isnan(around.at(q, 31.0).payload[0])


def test_the_first_command_and_the_second_are_taken_as_they_come() -> None:
    around = Surroundings(2)
    q = np.array([0.3, 0.4])
    around.moved(q, 10 * MS)
    at = around.at(q, 0.0)
    for nothing in (at.velocity, at.acceleration, at.direction):
        np.testing.assert_array_equal(nothing, [[0.0, 0.0]])
    around.moved(q + np.array([0.001, 0.0]), 20 * MS)
    at = around.at(q, 0.0)
    np.testing.assert_allclose(at.velocity, [[0.1, 0.0]], atol=1e-9)
    assert not at.acceleration.any()
    np.testing.assert_array_equal(at.direction, [[1.0, 0.0]])


def test_a_command_that_repeats_the_last_stands_still() -> None:
    around = Surroundings(1)
    stream(around, np.arange(5) * 0.01, np.arange(5.0)[:, None] * 0.01)
    around.moved(np.array([0.04]), 50 * MS)
    at = around.at(np.array([0.04]), 0.0)
    assert at.velocity[0, 0] == at.acceleration[0, 0] == 0
    assert at.direction[0, 0] == 1


def test_after_a_reset_the_motion_is_forgotten_and_the_rest_is_not() -> None:
    around = Surroundings(1)
    around.carries(1.5, np.zeros(3), 0.0)
    stream(around, np.arange(5) * 0.01, np.arange(5.0)[:, None] * 0.01)
    around.reset()
    at = around.at(np.array([0.04]), 0.0)
    np.testing.assert_array_equal(at.velocity, [[0.0]])
    np.testing.assert_array_equal(at.direction, [[0.0]])
    assert at.payload[0] == 1.5


def test_a_stream_far_in_the_past_or_of_odd_periods_gives_its_speed() -> None:
    around = Surroundings(1)
    time = 1.7e9 + np.cumsum(np.random.default_rng(0).uniform(0.001, 0.03, 60))
    for t in time:
        around.moved(np.array([0.5 * (t - 1.7e9)]), round(t * 1e9))
    at = around.at(np.zeros(1), 0.0)
    np.testing.assert_allclose(at.velocity, 0.5, rtol=1e-4)


def test_no_peer_fills_memory_with_names_of_parts() -> None:
    around = Surroundings(1)
    for k in range(MOST_PARTS):
        around.is_warm(f"part {k}", 20.0, 0.0)
    with pytest.raises(InputError, match="which is the limit"):
        around.is_warm("another", 20.0, 0.0)
    around.is_warm("part 7", 25.0, 1.0)
    assert len(around.known(1.0).parts) == MOST_PARTS
