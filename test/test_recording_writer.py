from __future__ import annotations

import errno
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability
from ruamel.yaml import YAML

from delta_calibration.errors import InputError
from delta_calibration.recording import SessionWriter, read_messages, read_session, write_session
from delta_calibration.recording import writer as writer_module
from delta_calibration.recording.messages import JOINT_STATE, encode_joint_state
from recording_helpers import NAMES, START_NS, assert_same_streams, make_session

RECORDED = {
    "/joint_command",
    "/joint_states",
    "/tracker/pose",
    "/cell/temperature",
    "/cell/payload",
}


def joint_message(k: int) -> bytes:
    return encode_joint_state(START_NS + k, NAMES, (0.1, 0.2, k * 1e-3))


def write_joints(writer: SessionWriter, count: int) -> None:
    for k in range(count):
        writer.write("/joint_states", JOINT_STATE, START_NS + k, joint_message(k))


def metadata_of(folder: Path) -> dict[str, Any]:
    content = YAML(typ="safe").load((folder / "metadata.yaml").read_text())
    information: dict[str, Any] = content["rosbag2_bagfile_information"]
    return information


@pytest.mark.parametrize("point", [False, True])
def test_written_session_is_read_back_equal(tmp_path: Path, point: bool) -> None:
    session = make_session(np.random.default_rng(5), point=point)
    write_session(tmp_path / "s", session, {"plan": "disc", "seed": "4"})
    read = read_session(tmp_path / "s")
    assert_same_streams(read, session)
    assert read.metadata == {"robot": "srbd", "seed": "4", "plan": "disc"}
    assert read.notes == ()
    assert read.source == str(tmp_path / "s")


def test_messages_lie_in_order_of_time(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(6), 50)
    write_session(tmp_path / "s", session)
    with (tmp_path / "s" / "s_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        times = [m.log_time for _, _, m in reader.iter_messages(log_time_order=False)]
    assert times == sorted(times)
    assert len(times) == 150 + 10 + 1


def test_rosbags_reads_it(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(7))
    write_session(tmp_path / "s", session, {"seed": "1"})
    positions = []
    with AnyReader([tmp_path / "s"]) as reader:  # compares hashes with definitions
        assert {c.topic for c in reader.connections} == RECORDED
        assert reader.message_count == 3 * 200 + 2 * 20 + 4
        named = [c for c in reader.connections if c.topic == "/joint_states"]
        for connection, _, data in reader.messages(connections=named):
            message: Any = reader.deserialize(data, connection.msgtype)
            positions.append(message.position)
        payload = next(c for c in reader.connections if c.topic == "/cell/payload").ext
    assert session.states is not None
    np.testing.assert_array_equal(positions, session.states.position)
    assert isinstance(payload, ConnectionExtRosbag2)
    assert payload.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL


@pytest.mark.filterwarnings("ignore:.*module is deprecated:DeprecationWarning")
def test_mcap_ros2_reads_it(tmp_path: Path) -> None:
    from mcap_ros2.reader import read_ros2_messages  # deprecated, but widely used

    session = make_session(np.random.default_rng(8))
    write_session(tmp_path / "s", session)
    points = [
        [m.ros_msg.pose.position.x, m.ros_msg.pose.position.y, m.ros_msg.pose.position.z]
        for m in read_ros2_messages(tmp_path / "s" / "s_0.mcap", topics=["/tracker/pose"])
    ]
    assert session.tracker is not None
    np.testing.assert_array_equal(points, session.tracker.position)


@pytest.mark.skipif(shutil.which("mcap") is None, reason="the mcap command is not installed")
def test_mcap_command_finds_nothing_wrong(tmp_path: Path) -> None:
    write_session(tmp_path / "s", make_session(np.random.default_rng(9)))
    file = str(tmp_path / "s" / "s_0.mcap")
    assert subprocess.run(["mcap", "doctor", file], check=False).returncode == 0
    told = subprocess.run(["mcap", "info", file], check=True, capture_output=True, text=True)
    assert "/joint_states" in told.stdout


def test_channels_say_what_ros_writes(tmp_path: Path) -> None:
    with SessionWriter(tmp_path / "s") as writer:
        write_joints(writer, 3)
    with (tmp_path / "s" / "s_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        assert len(list(reader.iter_messages())) == 3
    (channel,) = summary.channels.values()
    (schema,) = summary.schemas.values()
    assert channel.message_encoding == "cdr"
    assert channel.metadata == {
        "offered_qos_profiles": "[]",
        "topic_type_hash": "RIHS01_"
        "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    }
    assert (schema.name, schema.encoding) == (JOINT_STATE, "ros2msg")
    inner = YAML(typ="safe").load(metadata["rosbag2"]["serialized_metadata"])
    assert inner == metadata_of(tmp_path / "s")


def test_metadata_yaml_is_version_9_with_the_facts(tmp_path: Path) -> None:
    with SessionWriter(tmp_path / "s", {"robot_hash": "ab", "seed": "1"}) as writer:
        write_joints(writer, 5)
    found = metadata_of(tmp_path / "s")
    assert found["version"] == 9
    assert found["storage_identifier"] == "mcap"
    assert found["relative_file_paths"] == ["s_0.mcap"]
    assert found["message_count"] == found["files"][0]["message_count"] == 5
    assert found["starting_time"]["nanoseconds_since_epoch"] == START_NS
    assert found["duration"]["nanoseconds"] == 4
    assert found["custom_data"] == {"robot_hash": "ab", "seed": "1"}
    (topic,) = found["topics_with_message_count"]
    assert topic["message_count"] == 5
    assert topic["topic_metadata"]["name"] == "/joint_states"
    assert topic["topic_metadata"]["type"] == JOINT_STATE
    assert topic["topic_metadata"]["type_description_hash"].startswith("RIHS01_a13ee3a330e3")


def test_metadata_yaml_is_there_before_the_end(tmp_path: Path) -> None:
    writer = SessionWriter(tmp_path / "s", {"seed": "1"})
    assert metadata_of(tmp_path / "s")["custom_data"] == {"seed": "1"}
    write_joints(writer, 1)
    (topic,) = metadata_of(tmp_path / "s")["topics_with_message_count"]
    assert topic["topic_metadata"]["name"] == "/joint_states"
    writer.close()


def test_empty_recording_is_a_sound_file(tmp_path: Path) -> None:
    SessionWriter(tmp_path / "s").close()
    with AnyReader([tmp_path / "s" / "s_0.mcap"]) as reader:
        assert reader.message_count == 0
    assert metadata_of(tmp_path / "s")["duration"]["nanoseconds"] == 0


@pytest.mark.parametrize(("compression", "told"), [("none", ""), ("zstd", "zstd")])
def test_chunks_are_64_kib(tmp_path: Path, compression: str, told: str) -> None:
    with SessionWriter(tmp_path / "s", compression=compression) as writer:
        write_joints(writer, 3000)
    with (tmp_path / "s" / "s_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    sizes = [chunk.uncompressed_size for chunk in summary.chunk_indexes]
    assert len(sizes) == pytest.approx(3000 * 131 / 65536, abs=1)
    assert max(sizes) < 66_500
    assert {chunk.compression for chunk in summary.chunk_indexes} == {told}


def test_a_full_chunk_is_in_the_file_at_once(tmp_path: Path) -> None:
    writer = SessionWriter(tmp_path / "s")
    write_joints(writer, 501)  # one more than a chunk holds
    assert (tmp_path / "s" / "s_0.mcap").stat().st_size > 5000
    assert len(read_messages(tmp_path / "s")[0]) >= 500
    writer.close()


def test_slow_topics_reach_the_disk_after_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    synced: list[int] = []
    monkeypatch.setattr(writer_module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(os, "fsync", synced.append)
    writer = SessionWriter(tmp_path / "s")
    write_joints(writer, 2)
    before = len(synced)
    now[0] += 1.1
    write_joints(writer, 1)
    assert len(synced) == before + 1
    assert len(read_messages(tmp_path / "s")[0]) == 3
    writer.close()


def test_sync_puts_everything_there(tmp_path: Path) -> None:
    writer = SessionWriter(tmp_path / "s")
    write_joints(writer, 2)
    writer.sync()
    assert len(read_messages(tmp_path / "s")[0]) == 2
    writer.close()


def test_raw_bytes_and_both_times_are_kept(tmp_path: Path) -> None:
    wire = bytearray(joint_message(1)) + b"\x00\x00\x00\x00\x00\x00\x00\x00"
    with SessionWriter(tmp_path / "s") as writer:
        writer.write("js", JOINT_STATE, START_NS, bytes(wire), START_NS - 5)
    with (tmp_path / "s" / "s_0.mcap").open("rb") as stream:
        ((_, channel, message),) = make_reader(stream).iter_messages()
    assert channel.topic == "js"
    assert message.data == wire
    assert (message.log_time, message.publish_time) == (START_NS, START_NS - 5)


def test_an_existing_recording_is_never_overwritten(tmp_path: Path) -> None:
    with SessionWriter(tmp_path / "s") as writer:
        write_joints(writer, 1)
    before = (tmp_path / "s" / "s_0.mcap").read_bytes()
    with pytest.raises(InputError, match=r"s exists already"):
        SessionWriter(tmp_path / "s")
    with pytest.raises(InputError, match=r"exists already"):
        SessionWriter(tmp_path / "s" / "metadata.yaml")
    assert (tmp_path / "s" / "s_0.mcap").read_bytes() == before


def test_an_empty_folder_and_new_parents_are_taken(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "empty", tmp_path / "a" / "b" / "c"):
        with SessionWriter(path) as writer:
            write_joints(writer, 1)
        assert len(read_messages(path)[0]) == 1


def test_a_place_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match=r"file/s: a recording cannot be made there: Not a dir"):
        SessionWriter(tmp_path / "file" / "s")


def test_a_failure_within_still_closes_the_file(tmp_path: Path) -> None:
    def record() -> None:
        with SessionWriter(tmp_path / "s") as writer:
            write_joints(writer, 4)
            raise RuntimeError("a node died")

    with pytest.raises(RuntimeError, match="a node died"):
        record()
    assert metadata_of(tmp_path / "s")["message_count"] == 4


def test_a_full_disk_is_said_and_what_was_written_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    writer = SessionWriter(tmp_path / "s")
    write_joints(writer, 600)  # one chunk has been written
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        InputError, match=r"s: writing failed after 600 messages: No space left on device"
    ):
        writer.sync()
    with pytest.raises(InputError, match="closed"):
        write_joints(writer, 1)
    writer.close()
    assert len(read_messages(tmp_path / "s")[0]) >= 500


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_a_really_full_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = SessionWriter(tmp_path / "s")
    with Path("/dev/full").open("wb") as full:
        os.dup2(full.fileno(), writer._stream.fileno())
    with pytest.raises(InputError, match=r"writing failed after \d+ messages: No space left"):
        write_joints(writer, 5000)


def test_interruption_within_a_message_leaves_whole_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = SessionWriter(tmp_path / "s")
    write_joints(writer, 700)
    monkeypatch.setattr(writer._writer, "add_message", _interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_joints(writer, 1)
    writer.close()
    messages, notes = read_messages(tmp_path / "s")
    assert 500 <= len(messages) <= 700
    assert "cut off" in notes[0]


def _interrupted(*_: object) -> None:
    raise KeyboardInterrupt


def test_wrong_use_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"compression 'lzma': none or zstd"):
        SessionWriter(tmp_path / "s", compression="lzma")
    writer = SessionWriter(tmp_path / "s")
    write_joints(writer, 1)
    with pytest.raises(InputError, match=r"/joint_states is recorded as sensor_msgs/msg/JointSta"):
        writer.write("/joint_states", "geometry_msgs/msg/PoseStamped", START_NS, b"")
    with pytest.raises(InputError, match="without a name"):
        writer.write("", JOINT_STATE, START_NS, joint_message(0))
    with pytest.raises(InputError, match="is unknown"):
        writer.write("/x", "my_msgs/msg/X", START_NS, b"")
    with pytest.raises(InputError, match="-1 ns is negative"):
        writer.write("/joint_states", JOINT_STATE, -1, joint_message(0))
    writer.close()
    writer.close()
    with pytest.raises(InputError, match="is closed"):
        writer.write("/joint_states", JOINT_STATE, START_NS, joint_message(0))
    assert metadata_of(tmp_path / "s")["message_count"] == 1


def test_negative_stamps_of_a_session_are_refused_before_anything_is_made(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(1), 3)
    assert session.command is not None
    session.command.stamp_ns[0] = -4
    with pytest.raises(InputError, match=r"/joint_command: stamp -4 ns is negative"):
        write_session(tmp_path / "s", session)
    assert not (tmp_path / "s").exists()
