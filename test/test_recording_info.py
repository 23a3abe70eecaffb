from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin, Writer

from delta_calibration.errors import RecordingError
from delta_calibration.recording import info as info_module
from delta_calibration.recording import inspect_session, write_session
from delta_calibration.recording.messages import JOINT_STATE
from recording_helpers import NAMES, NONE, START_NS, STORE, foreign_mcap, make_session, ros_joints


def test_facts_of_a_written_session(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(21))
    write_session(tmp_path / "s", session)
    info = inspect_session(tmp_path / "s")
    assert info.files == ("s_0.mcap",)
    assert (info.storage, info.compression, info.complete) == ("mcap", "zstd", True)
    assert info.chunks == 2
    assert info.size_bytes == (tmp_path / "s" / "s_0.mcap").stat().st_size
    assert info.start_ns == START_NS
    assert info.duration_s == pytest.approx(199 * 1.000001e-3 + 11e-9, rel=1e-12)
    assert info.message_count == 644
    assert {topic.name: topic.count for topic in info.topics} == {
        "/cell/payload": 4,
        "/cell/temperature": 40,
        "/joint_command": 200,
        "/joint_states": 200,
        "/tracker/pose": 200,
    }
    command = next(topic for topic in info.topics if topic.name == "/joint_command")
    assert command.type_name == JOINT_STATE
    assert command.rate_hz == pytest.approx(200 / info.duration_s)
    assert info.custom_data == session.metadata
    assert info.notes == ()


def test_the_index_and_a_whole_reading_say_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_session(tmp_path / "s", make_session(np.random.default_rng(22)))
    indexed = inspect_session(tmp_path / "s")
    monkeypatch.setattr(info_module, "_read_index", lambda *_: False)
    assert inspect_session(tmp_path / "s") == indexed


def test_the_index_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_session(tmp_path / "s", make_session(np.random.default_rng(22)))
    monkeypatch.delattr(info_module, "load_raw")
    assert inspect_session(tmp_path / "s").message_count == 644


def test_a_bare_file_keeps_its_provenance(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(23), 20)
    write_session(tmp_path / "s", session)
    moved = (tmp_path / "s" / "s_0.mcap").rename(tmp_path / "moved.mcap")
    assert inspect_session(moved).custom_data == session.metadata


@pytest.mark.parametrize("chunked", [True, False])
def test_a_cut_off_file_is_counted_by_reading(tmp_path: Path, chunked: bool) -> None:
    rows = [
        ("/joint_states", JOINT_STATE, START_NS + k, ros_joints(START_NS + k, NAMES, [0.0] * 3))
        for k in range(400)
    ]
    path = foreign_mcap(
        tmp_path / "f.mcap", rows, compression=CompressionType.NONE, chunked=chunked
    )
    path.write_bytes(path.read_bytes()[: len(path.read_bytes()) // 2])
    info = inspect_session(path)
    assert not info.complete
    assert 100 < info.message_count < 350
    assert info.duration_s == pytest.approx((info.message_count - 1) * 1e-9)
    assert "cut off" in info.notes[0]


def test_sqlite_storage_is_told(tmp_path: Path) -> None:
    with Writer(tmp_path / "r", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        opened = writer.add_connection("/joint_states", JOINT_STATE, typestore=STORE)
        for k in range(7):
            writer.write(opened, START_NS + k, ros_joints(START_NS + k, NAMES, [0.0] * 3))
    info = inspect_session(tmp_path / "r")
    assert (info.storage, info.message_count, info.duration_s) == ("sqlite3", 7, 6e-9)


def test_an_empty_recording_has_no_duration(tmp_path: Path) -> None:
    info = inspect_session(foreign_mcap(tmp_path / "f.mcap", []))
    assert (info.message_count, info.duration_s, info.topics) == (0, 0.0, ())


def test_what_is_no_recording_is_said(tmp_path: Path) -> None:
    (tmp_path / "f.mcap").write_text("not one")
    with pytest.raises(RecordingError, match=r"f.mcap is not an MCAP file"):
        inspect_session(tmp_path / "f.mcap")
    with pytest.raises(RecordingError, match="does not exist"):
        inspect_session(tmp_path / "g.mcap")


@pytest.mark.skipif(not NONE.exists(), reason="the shared sessions are not beside the repository")
def test_shared_session() -> None:
    info = inspect_session(NONE)
    assert info.message_count == 43813
    assert info.duration_s == pytest.approx(7542.55)
    assert (info.chunks, info.compression) == (6, "none")
