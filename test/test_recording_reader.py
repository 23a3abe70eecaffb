from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from delta_calibration.data.streams import Session
from delta_calibration.errors import RecordingError
from delta_calibration.recording import Topics, read_messages, read_session, write_session
from delta_calibration.recording.messages import (
    POSE_STAMPED,
)
from recording_helpers import (
    COMMAND,
    NONE,
    POSE,
    START_NS,
    STATES,
    STORE,
    Sent,
    assert_same_streams,
    both,
    foreign_mcap,
    joints,
    make_session,
    pose,
)


def resent(path: Path, session: Session, folder: Path) -> list[Sent]:
    write_session(folder, session)
    return [(m.topic, m.type_name, m.log_time_ns, m.data) for m in read_messages(folder)[0]]


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("chunk_size", [200, 1 << 20])
def test_any_chunking_and_compression(
    tmp_path: Path, compression: CompressionType, chunk_size: int
) -> None:
    session = make_session(np.random.default_rng(11))
    sent = resent(tmp_path, session, tmp_path / "s")
    file = foreign_mcap(tmp_path / "f.mcap", sent, compression=compression, chunk_size=chunk_size)
    read = read_session(file)
    assert_same_streams(read, session)
    assert read.notes == ()


def test_without_chunks(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(11), 40)
    sent = resent(tmp_path, session, tmp_path / "s")
    assert_same_streams(
        read_session(foreign_mcap(tmp_path / "f.mcap", sent, chunked=False)), session
    )


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        *((StoragePlugin.MCAP, mode) for mode in CompressionMode),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_rosbag2_folders_of_rosbags(
    tmp_path: Path, storage: StoragePlugin, mode: CompressionMode
) -> None:
    session = make_session(np.random.default_rng(12), 40)
    sent = resent(tmp_path, session, tmp_path / "s")
    rosbags_folder(tmp_path / "r", sent, storage, mode)
    read = read_session(tmp_path / "r")
    assert_same_streams(read, session)
    assert read.metadata == {"robot": "theirs"}


def rosbags_folder(
    path: Path, sent: list[Sent], storage: StoragePlugin, mode: CompressionMode
) -> None:
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    writer.set_custom_data("robot", "theirs")
    with writer:
        topics = {(topic, type_name) for topic, type_name, _, _ in sent}
        opened = {t: writer.add_connection(*t, typestore=STORE) for t in sorted(topics)}
        for topic, type_name, log_time, data in sent:
            writer.write(opened[topic, type_name], log_time, data)


def test_compressed_sqlite_is_refused(tmp_path: Path) -> None:
    rosbags_folder(tmp_path / "r", both(5), StoragePlugin.SQLITE3, CompressionMode.FILE)
    with pytest.raises(RecordingError, match=r"db3.zstd is compressed SQLite: unpack it"):
        read_session(tmp_path / "r")


def test_messages_that_are_not_compressed_as_said(tmp_path: Path) -> None:
    rosbags_folder(tmp_path / "r", both(5), StoragePlugin.MCAP, CompressionMode.NONE)
    file = tmp_path / "r" / "metadata.yaml"
    file.write_text(file.read_text().replace("compression_mode: ''", "compression_mode: MESSAGE"))
    with pytest.raises(RecordingError, match="says that messages are compressed, but"):
        read_session(tmp_path / "r")


def test_folder_metadata_yaml_and_bare_file_are_the_same_session(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(13), 30)
    write_session(tmp_path / "s", session)
    for path in ("s", "s/metadata.yaml", "s/s_0.mcap"):
        read = read_session(tmp_path / path)
        assert_same_streams(read, session)
        assert read.metadata == session.metadata


def test_several_files_are_read_in_the_order_listed(tmp_path: Path) -> None:
    files = []
    for part in range(12):
        rows = [m for k in range(part * 5, part * 5 + 5) for m in (joints(k), pose(k))]
        foreign_mcap(tmp_path / f"bag_{part}.mcap", rows)
        files.append(f"bag_{part}.mcap")
    # Without metadata.yaml, files are sorted by number (bag_10 after bag_9); with it, as it lists
    # them.
    read = read_session(tmp_path)
    assert read.states is not None
    np.testing.assert_array_equal(read.states.position[:, 0], np.arange(60))
    assert len(read.notes) == 1
    assert "metadata.yaml is missing" in read.notes[0]
    listed = "\n".join(f"  - {name}" for name in [*files[:10], files[11], "bag_99.mcap"])
    (tmp_path / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n{listed}\n"
    )
    read = read_session(tmp_path)
    assert read.states is not None
    np.testing.assert_array_equal(np.sort(read.states.position[:, 0]), np.arange(60))
    assert "bag_99.mcap: listed in metadata.yaml but missing" in read.notes[0]
    assert "bag_10.mcap: not listed in metadata.yaml, but read as well" in read.notes[1]


def test_one_empty_file_of_several_costs_only_itself(tmp_path: Path) -> None:
    foreign_mcap(tmp_path / "bag_0.mcap", both(5))
    (tmp_path / "bag_1.mcap").touch()
    read = read_session(tmp_path)
    assert read.states is not None
    assert len(read.states.stamp_ns) == 5
    assert "bag_1.mcap is empty (0 bytes): its data is lost" in read.notes[1]


def test_extra_topics_are_ignored_but_a_player_gets_them(tmp_path: Path) -> None:
    clock = [("/clock", "rosgraph_msgs/msg/Clock", START_NS + k, bytes(12)) for k in range(5)]
    path = foreign_mcap(tmp_path / "f.mcap", [*both(5), *clock])
    read = read_session(path)
    assert read.notes == ()
    messages, _ = read_messages(path)
    assert len(messages) == 15
    assert [m.log_time_ns for m in messages] == sorted(m.log_time_ns for m in messages)


def test_paths_that_hold_no_recording(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "zero.mcap").touch()
    (tmp_path / "text.mcap").write_text("x,y,z\n" * 100)
    (tmp_path / "table.csv").write_text("x,y,z\n" * 100)
    (tmp_path / "cal.yaml").write_text("robot: srbd\n")
    for name in ("run_10", "run_9"):
        (tmp_path / "week" / name).mkdir(parents=True)
        (tmp_path / "week" / name / "metadata.yaml").touch()
    (tmp_path / "other.db3").write_bytes(b"SQLite format 3\0" + bytes(200))
    with closing(sqlite3.connect(tmp_path / "tables.db3")) as base:
        base.execute("CREATE TABLE things (id INTEGER)")
    (tmp_path / "torn.mcap.zstd").write_bytes(zstandard.compress(bytes(5000))[:4] + b"\xff" * 30)
    for name, why in {
        "nowhere": r"nowhere does not exist",
        "empty": r"empty contains no recording \(no .mcap or .db3 file\)",
        "zero.mcap": r"zero.mcap is empty \(0 bytes\)",
        "text.mcap": r"text.mcap is not an MCAP file$",
        "table.csv": r"table.csv is not an MCAP file; `delta-cal import` converts tables",
        "cal.yaml": r"cal.yaml is not an MCAP file; a session is a folder with .mcap or .db3",
        "week": r"week contains no recording .*; recordings in it: run_9, run_10$",
        "other.db3": r"other.db3 cannot be read: ",
        "tables.db3": r"tables.db3 cannot be read: no such table: topics",
        "torn.mcap.zstd": r"torn.mcap.zstd cannot be read: ",
    }.items():
        with pytest.raises(RecordingError, match=why) as caught:
            read_session(tmp_path / name)
        assert "\n" not in str(caught.value)
        assert caught.value.exit_code == 2


def test_unknown_chunk_compression_is_named(tmp_path: Path) -> None:
    path = foreign_mcap(tmp_path / "f.mcap", both(5), compression=CompressionType.LZ4)
    path.write_bytes(path.read_bytes().replace(b"\x03\x00\x00\x00lz4", b"\x03\x00\x00\x00xyz"))
    with pytest.raises(RecordingError, match=r"f.mcap has chunks compressed by 'xyz': none, lz4"):
        read_session(path)


def test_missing_streams_name_what_is_there_and_the_option(tmp_path: Path) -> None:
    only_joints = foreign_mcap(tmp_path / "j.mcap", [joints(k) for k in range(3)])
    with pytest.raises(
        RecordingError,
        match=r"j.mcap: no tracker readings: expected tracker/pose or tracker/point, recorded are"
        r" /joint_states; --topic tracker_pose=NAME",
    ):
        read_session(only_joints)
    partial = read_session(only_joints, partial=True)
    assert partial.tracker is None
    assert partial.states is not None
    only_tracker = foreign_mcap(tmp_path / "t.mcap", [pose(k) for k in range(3)])
    with pytest.raises(RecordingError, match=r"no joint angles: .*--topic command=NAME"):
        read_session(only_tracker)


def test_missing_streams_name_the_topics_of_their_type(tmp_path: Path) -> None:
    named = {"/joint_states": "/plc/actual", "/tracker/pose": "/leica/pose"}
    messages = [m for k in range(3) for m in (joints(k), pose(k))]
    path = foreign_mcap(tmp_path / "o.mcap", [(named.get(m[0], m[0]), *m[1:]) for m in messages])
    with pytest.raises(RecordingError, match=r"of that type: --topic command=/plc/actual$"):
        read_session(path)
    with pytest.raises(RecordingError, match=r"of that type: --topic tracker_pose=/leica/pose$"):
        read_session(path, Topics(command="/plc/actual"))


def test_a_topic_of_another_type_is_named(tmp_path: Path) -> None:
    rows = [(STATES, POSE_STAMPED, START_NS, pose(0)[3]), pose(0)]
    with pytest.raises(
        RecordingError,
        match=r"/joint_states is geometry_msgs/msg/PoseStamped \(cdr\), not sensor_msgs/msg/Joint",
    ):
        read_session(foreign_mcap(tmp_path / "f.mcap", rows))
    read = read_session(
        foreign_mcap(tmp_path / "g.mcap", [*rows, joints(0, COMMAND)]), Topics(states="")
    )
    assert read.states is None


def test_another_encoding_is_named(tmp_path: Path) -> None:
    path = foreign_mcap(tmp_path / "f.mcap", both(3), encoding="json")
    with pytest.raises(RecordingError, match=r"\(json\), not sensor_msgs/msg/JointState \(cdr\)"):
        read_session(path)


def test_a_recording_without_messages_is_said(tmp_path: Path) -> None:
    for read in (read_session, read_messages):
        with pytest.raises(RecordingError, match=r"f.mcap: the recording contains no messages"):
            read(foreign_mcap(tmp_path / "f.mcap", []))


def test_all_readings_unusable_is_said_with_the_reason(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(17), 20, point=True)
    assert session.tracker is not None
    lost = replace(session, tracker=replace(session.tracker, position=np.full((20, 3), np.nan)))
    write_session(tmp_path / "s", lost)
    with pytest.raises(
        RecordingError,
        match=r"no tracker readings.*/tracker/point: 20 readings that are not finite",
    ):
        read_session(tmp_path / "s")


@pytest.mark.skipif(not NONE.exists(), reason="the shared sessions are not beside the repository")
def test_shared_session_equals_what_rosbags_reads() -> None:
    read = read_session(NONE)
    assert read.notes == ()
    assert read.command is not None
    assert read.states is not None
    assert read.tracker is not None
    assert read.payload is not None
    assert read.command.position.shape == (14452, 3)
    assert [(t.part, len(t.celsius)) for t in read.temperature] == [("arm", 226), ("base", 226)]
    rows: dict[str, list[tuple[float, ...]]] = {STATES: [], POSE: []}
    with AnyReader([NONE]) as reader:
        wanted = [c for c in reader.connections if c.topic in rows]
        stop = reader.start_time + 300_000_000_000
        for connection, _, data in reader.messages(connections=wanted, stop=stop):
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == STATES:
                rows[STATES].append(tuple(message.position))  # type: ignore[attr-defined]
            else:
                at = message.pose.position  # type: ignore[attr-defined]
                rows[POSE].append((at.x, at.y, at.z))
    n = len(rows[STATES])
    assert n > 300
    np.testing.assert_array_equal(read.states.position[:n], rows[STATES])
    np.testing.assert_array_equal(read.tracker.position[: len(rows[POSE])], rows[POSE])
