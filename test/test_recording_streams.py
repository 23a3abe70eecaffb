from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from delta_calibration.errors import RecordingError
from delta_calibration.recording import read_session, write_session
from delta_calibration.recording.messages import (
    JOINT_STATE,
    TEMPERATURE,
    encode_temperature,
)
from recording_helpers import (
    COMMAND,
    MS,
    NAMES,
    START_NS,
    STATES,
    Sent,
    both,
    foreign_mcap,
    joints,
    make_session,
    pose,
    ros_joints,
)


def test_joints_are_put_into_one_order_by_name(tmp_path: Path) -> None:
    def shuffled(k: int) -> Sent:
        names = (NAMES, NAMES[::-1], (*NAMES[1:], NAMES[0]))[k % 3]
        position = [100.0 * k + int(name[-1]) for name in names]
        stamp = START_NS + k * MS
        return STATES, JOINT_STATE, stamp, ros_joints(stamp, names, position, [0.0] * (k % 4))

    read = read_session(foreign_mcap(tmp_path / "f.mcap", both(40, shuffled)))
    assert read.states is not None
    expected = 100.0 * np.arange(40)[:, None] + [1, 2, 3]
    columns = [read.states.names.index(name) for name in NAMES]
    np.testing.assert_array_equal(read.states.position[:, columns], expected)


def test_states_take_the_order_of_the_command_and_leave_its_extra_joints(tmp_path: Path) -> None:
    command = [joints(k, COMMAND) for k in range(4)]
    names = ("gripper", "joint_3", "joint_1", "joint_2")
    rows = [
        (STATES, JOINT_STATE, START_NS + k, ros_joints(START_NS + k, names, [9.0, 3.0, 1.0, 2.0]))
        for k in range(4)
    ]
    read = read_session(foreign_mcap(tmp_path / "f.mcap", [*command, *rows, pose(0)]))
    assert read.states is not None
    assert read.states.names == NAMES
    np.testing.assert_array_equal(read.states.position, np.tile([1.0, 2.0, 3.0], (4, 1)))
    assert read.notes == ("/joint_states: joints gripper ignored",)


def test_joint_messages_that_lack_something_are_counted(tmp_path: Path) -> None:
    def some(k: int) -> Sent:
        stamp = START_NS + k * MS
        data = {
            0: ros_joints(stamp, NAMES[:2], [0.0, 0.0]),
            1: ros_joints(stamp, (), [0.0, 0.0, 0.0]),
            2: ros_joints(stamp, NAMES, [], [0.0, 0.0, 0.0]),
        }.get(k, joints(k)[3])
        return STATES, JOINT_STATE, stamp, data

    read = read_session(foreign_mcap(tmp_path / "f.mcap", both(10, some)))
    assert read.states is not None
    np.testing.assert_array_equal(read.states.position[:, 0], np.arange(3, 10))
    assert len(read.notes) == 1
    assert "/joint_states: 3 messages without a position for each of joint_1" in read.notes[0]


def test_joint_messages_without_names_are_no_joint_angles(tmp_path: Path) -> None:
    rows = both(3, lambda k: (STATES, JOINT_STATE, START_NS + k, ros_joints(1, (), [0.0])))
    with pytest.raises(RecordingError, match=r"no joint angles.*no message carries joint names"):
        read_session(foreign_mcap(tmp_path / "f.mcap", rows))


def test_zero_stamps_give_way_to_times_of_arrival(tmp_path: Path) -> None:
    rows = both(5, lambda k: (STATES, JOINT_STATE, START_NS + k, ros_joints(0, NAMES, [1.0] * 3)))
    read = read_session(foreign_mcap(tmp_path / "f.mcap", rows))
    assert read.states is not None
    np.testing.assert_array_equal(read.states.stamp_ns, START_NS + np.arange(5))
    assert read.notes == (
        "/joint_states: all stamps are zero; the times of arrival are used instead",
    )


def test_stamps_are_those_of_the_headers(tmp_path: Path) -> None:
    rows = [
        (topic, type_name, log_time + 123_456, data)
        for topic, type_name, log_time, data in both(3)
    ]
    read = read_session(foreign_mcap(tmp_path / "f.mcap", rows))
    assert read.states is not None
    np.testing.assert_array_equal(read.states.stamp_ns, START_NS + MS * np.arange(3))


def test_readings_that_no_machine_gives_are_kept_out_and_counted(tmp_path: Path) -> None:
    """Their squares would overflow."""
    session = make_session(np.random.default_rng(15), 60)
    assert session.states is not None
    session.states.position[[7, 9], 2] = 1e200, -1e10
    write_session(tmp_path / "s", session)
    read = read_session(tmp_path / "s")
    assert read.states is not None
    assert len(read.states.stamp_ns) == 58
    assert "/joint_states: 2 readings beyond 1e+09 were left out" in read.notes


def test_readings_that_are_not_finite_are_kept_out_and_counted(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(15), 60)
    assert session.tracker is not None
    assert session.states is not None
    assert session.payload is not None
    session.tracker.position[[3, 4], 1] = np.nan
    session.states.position[7, 2] = np.inf
    session.temperature[0].celsius[2] = np.nan
    session.payload.centre[0, 0] = np.nan
    write_session(tmp_path / "s", session)
    read = read_session(tmp_path / "s")
    assert read.tracker is not None
    assert read.states is not None
    assert read.payload is not None
    kept = np.delete(np.arange(60), [3, 4])
    np.testing.assert_array_equal(read.tracker.position, session.tracker.position[kept])
    assert len(read.states.stamp_ns) == 59
    assert len(read.temperature[0].celsius) == 5
    assert len(read.payload.mass) == 1
    counts = {note.split(":")[0]: note.split()[1] for note in read.notes}
    assert counts == {
        "/joint_states": "1",
        "/tracker/pose": "2",
        "/cell/temperature": "1",
        "/cell/payload": "1",
    }


def test_poses_without_orientation_are_points(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(16), 20)
    assert session.tracker is not None
    assert session.tracker.quaternion is not None
    session.tracker.quaternion[4] = 0.0
    write_session(tmp_path / "one", session)
    one = read_session(tmp_path / "one")
    assert one.tracker is not None
    assert len(one.tracker.stamp_ns) == 19
    session.tracker.quaternion[:] = 0.0
    write_session(tmp_path / "all", session)
    read = read_session(tmp_path / "all")
    assert read.tracker is not None
    assert read.tracker.quaternion is None
    np.testing.assert_array_equal(read.tracker.position, session.tracker.position)
    assert "no pose has an orientation" in read.notes[0]


def test_stamps_that_run_backwards_are_sorted_and_said(tmp_path: Path) -> None:
    order = [0, 1, 4, 2, 3, 5]
    path = foreign_mcap(tmp_path / "f.mcap", [m for k in order for m in (joints(k), pose(k))])
    read = read_session(path)
    assert read.states is not None
    np.testing.assert_array_equal(read.states.position[:, 0], np.arange(6))
    assert "/joint_states: stamps run backwards 1 times" in read.notes[0]


def test_each_sensor_is_a_stream(tmp_path: Path) -> None:
    warm = [
        ("/cell/temperature", TEMPERATURE, START_NS + k, encode_temperature(START_NS + k, p, t))
        for k, (p, t) in enumerate([("base", 20.0), ("arm", 30.0), ("base", 21.0), ("elbow", 1.0)])
    ]
    read = read_session(foreign_mcap(tmp_path / "f.mcap", [*both(2), *warm]))
    assert [(t.part, t.celsius.tolist()) for t in read.temperature] == [
        ("base", [20.0, 21.0]),
        ("arm", [30.0]),
        ("elbow", [1.0]),
    ]


def test_undecodable_messages_are_counted(tmp_path: Path) -> None:
    rows = [*both(5), (STATES, JOINT_STATE, START_NS, b"\x00\x01\x00\x00\x01")]
    read = read_session(foreign_mcap(tmp_path / "f.mcap", rows))
    assert read.notes == (
        "/joint_states: 1 messages do not contain a valid sensor_msgs/msg/JointState and were "
        "left out",
    )
