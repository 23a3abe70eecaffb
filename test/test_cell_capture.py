"""A capture contains the messages between start and stop, and states what it lacks."""

from __future__ import annotations

import time

import numpy as np

from delta_calibration.cell.capture import Capture

NAMES = ("joint_1", "joint_2", "joint_3")
ANGLES = np.array([0.1, 0.2, 0.3])
POINT = np.array([1.0, 2.0, 3.0])
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def started(limit: int = 1000) -> Capture:
    capture = Capture(NAMES, limit)
    capture.start()
    return capture


def test_a_session_holds_every_stream_as_it_came() -> None:
    capture = started()
    for k in range(5):
        capture.add_command(10 * k, ANGLES + k)
        capture.add_states(10 * k + 1, ANGLES - k)
        capture.add_tracker(10 * k + 2, POINT * k)
    capture.add_temperature("arm", 7, 21.5)
    capture.add_temperature("base", 8, 20.5)
    capture.add_payload(9, 2.5, np.array([0.0, 0.0, 0.1]))
    session = capture.session("here")
    assert session.source == "here"
    assert session.command.names == NAMES
    np.testing.assert_array_equal(session.command.stamp_ns, [0, 10, 20, 30, 40])
    np.testing.assert_array_equal(session.command.position[3], ANGLES + 3)
    np.testing.assert_array_equal(session.states.position[2], ANGLES - 2)
    np.testing.assert_array_equal(session.tracker.position[4], POINT * 4)
    assert session.tracker.quaternion is None
    assert [t.part for t in session.temperature] == ["arm", "base"]
    assert session.temperature[0].celsius.tolist() == [21.5]
    assert session.payload.mass.tolist() == [2.5]
    np.testing.assert_array_equal(session.payload.centre, [[0.0, 0.0, 0.1]])
    assert session.notes == ()
    assert capture.held == 18 == sum(capture.counts.values())


def test_before_start_and_after_stop_nothing_is_taken() -> None:
    capture = Capture(NAMES, 10)
    capture.add_states(0, ANGLES)
    capture.add_tracker(0, np.concatenate([POINT]), UPRIGHT)
    assert capture.held == 0
    capture.start()
    capture.add_tracker(1, POINT)  # points: messages before the start have no influence
    capture.stop()
    capture.add_tracker(2, POINT)
    assert capture.session("x").tracker.stamp_ns.tolist() == [1]


def test_a_session_does_not_change_with_what_comes_later() -> None:
    capture = started()
    capture.add_states(0, ANGLES)
    session = capture.session("x")
    capture.add_states(1, ANGLES)
    assert len(session.states.stamp_ns) == 1


def test_a_second_start_begins_anew() -> None:
    capture = started(limit=2)
    for k in range(5):
        capture.add_states(k, ANGLES)
    capture.start()
    assert (capture.held, capture.lost) == (0, 0)


def test_at_the_limit_what_is_lost_is_counted_and_told() -> None:
    capture = started(limit=10)
    for k in range(8):
        capture.add_states(k, ANGLES)
        capture.add_tracker(k, POINT)
    assert (capture.held, capture.lost) == (10, 6)
    assert any("6 messages were lost" in note for note in capture.session("x").notes)


def test_the_payload_is_known_from_before_the_start() -> None:
    capture = Capture(NAMES, 10)
    capture.add_payload(3, 1.5, np.zeros(3))
    capture.start()
    session = capture.session("x")
    assert session.payload.stamp_ns.tolist() == [3]
    assert session.payload.mass.tolist() == [1.5]


def test_a_probe_gives_poses_and_points_among_them_are_told() -> None:
    capture = started()
    capture.add_tracker(0, POINT, UPRIGHT)
    capture.add_tracker(1, POINT)
    session = capture.session("x")
    np.testing.assert_array_equal(session.tracker.quaternion, [UPRIGHT])
    np.testing.assert_array_equal(session.tracker.position, [POINT])
    assert any("1 tracker messages of the other kind" in note for note in session.notes)


def test_time_going_backwards_is_told() -> None:
    capture = started()
    for stamp in (5, 6, 6, 2, 3):
        capture.add_states(stamp, ANGLES)
    assert any("time went backwards 1 times" in note for note in capture.session("x").notes)


def test_streams_without_messages_are_absent() -> None:
    session = started().session("x")
    assert session.command is session.states is session.tracker is session.payload is None
    assert session.temperature == ()


def test_what_is_frozen_stays_as_it_is_and_takes_no_time() -> None:
    """A fit starts between two commands, whatever was captured."""
    capture = Capture(NAMES, 1_000_000)
    capture.start()
    rows = np.random.default_rng(0).normal(size=(200_000, len(NAMES)))
    for k, row in enumerate(rows):
        capture.add_command(k, row)
        capture.add_states(k, row)
    capture.add_payload(0, 1.0, np.zeros(3))
    capture.add_temperature("arm", 0, 20.0)
    times = []
    for _ in range(5):
        began = time.perf_counter()
        frozen = capture.frozen()
        times.append(time.perf_counter() - began)
    assert min(times) < 2e-3
    capture.add_command(200_000, rows[0])
    capture.add_payload(1, 2.0, np.zeros(3))
    capture.add_temperature("arm", 1, 21.0)
    session = frozen.session("x")
    np.testing.assert_array_equal(session.command.position, rows)
    assert session.command.stamp_ns.tolist() == list(range(200_000))
    assert len(session.payload.stamp_ns) == len(session.temperature[0].stamp_ns) == 1
    assert capture.counts["joint_command"] == 200_001
