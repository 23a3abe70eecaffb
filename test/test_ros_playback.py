"""Messages that a player sends, and their times, without ROS."""

from __future__ import annotations

from pathlib import Path

import pytest

from delta_calibration.errors import InputError, RecordingError
from delta_calibration.recording import SessionWriter
from delta_calibration.recording.messages import encode_joint_state
from delta_calibration.ros.playback import PlaybackClock, Timeline, load_timeline, start_index

SECOND = 1_000_000_000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Two topics with messages out of order, as a recorder may write them."""
    with SessionWriter(tmp_path / "session", {}) as writer:
        for k in (0, 2, 1, 3, 4):
            topic = "/joint_states" if k % 2 else "/joint_command"
            data = encode_joint_state(k, ("joint_1",), (float(k),))
            writer.write(topic, "sensor_msgs/msg/JointState", k * SECOND, data)
    return tmp_path / "session"


def test_messages_come_in_the_order_of_their_log_times(path: Path) -> None:
    timeline = load_timeline(path)
    assert timeline.log_time_ns.tolist() == [k * SECOND for k in range(5)]
    assert [timeline.topics[i] for i in timeline.topic] == [
        "/joint_states" if k % 2 else "/joint_command" for k in range(5)
    ]
    assert timeline.last_before(1, 3) == 1
    assert timeline.last_before(1, 1) is None


@pytest.mark.parametrize("name", ["joint_states", "/joint_states"])
def test_one_topic_of_several(path: Path, name: str) -> None:
    timeline: Timeline = load_timeline(path, (name,))
    assert timeline.topics == ("/joint_states",)
    assert timeline.log_time_ns.tolist() == [SECOND, 3 * SECOND]
    assert (timeline.start_ns, timeline.end_ns) == (SECOND, 3 * SECOND)


def test_a_topic_that_is_not_there_is_named_with_those_that_are(path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no topic tracker/pose; it has \['joint_command'"):
        load_timeline(path, ("tracker/pose",))
    with pytest.raises(RecordingError, match="names no topic to play"):
        load_timeline(path, ())


def test_the_start_is_the_first_message_not_before_it(path: Path) -> None:
    timeline = load_timeline(path)
    assert [start_index(timeline, s) for s in (0.0, 1.0, 1.5, 4.0)] == [0, 1, 2, 4]
    with pytest.raises(InputError, match=r"lasts 4\.000 s"):
        start_index(timeline, 4.1)


def test_time_runs_at_its_rate_and_never_jumps_when_that_changes() -> None:
    clock = PlaybackClock(session_ns=100, wall_ns=1000, rate=2.0, paused=False)
    assert clock.at(1000) == 100
    assert clock.at(1010) == 120
    clock.change(1010, rate=0.5, paused=False)
    assert clock.at(1010) == 120
    assert clock.at(1030) == 130
    clock.change(1030, rate=0.5, paused=True)
    assert clock.at(9999) == 130
    clock.change(9999, rate=1.0, paused=False)
    assert clock.at(10009) == 140


def test_time_is_exact_far_from_the_start() -> None:
    clock = PlaybackClock(1_700_000_000_000_000_001, 5, rate=1.0, paused=False)
    assert clock.at(5 + 7200 * SECOND + 1) == 1_700_000_000_000_000_001 + 7200 * SECOND + 1
