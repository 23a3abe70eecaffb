from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin, Writer

from delta_calibration.errors import RecordingError
from delta_calibration.recording import (
    inspect_session,
    read_messages,
    read_session,
    write_session,
)
from delta_calibration.recording.messages import JOINT_STATE, POINT_STAMPED, encode_point
from recording_helpers import (
    NAMES,
    START_NS,
    STORE,
    assert_same_streams,
    foreign_mcap,
    make_session,
    ros_joints,
)

JOINTS, POINTS = "/joint_states", "/tracker/point"


def sent(n: int) -> list[tuple[str, str, int, bytes]]:
    rows = []
    for k in range(n):
        stamp = START_NS + k * 1_000_000
        joints = ros_joints(stamp, NAMES, (k, 2.0 * k, -0.5 * k))
        rows.append((JOINTS, JOINT_STATE, stamp, joints))
        rows.append((POINTS, POINT_STAMPED, stamp, encode_point(stamp, "tracker", (k, 0.0, 1.0))))
    return rows


SENT = sent(300)


def rows_of(path: Path) -> tuple[list[tuple[str, str, int, bytes]], tuple[str, ...]]:
    messages, notes = read_messages(path)
    return [(m.topic, m.type_name, m.log_time_ns, m.data) for m in messages], notes


@pytest.fixture(
    scope="module", params=["none", "lz4", "zstd", "unchunked"], ids=lambda name: str(name)
)
def foreign(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    kind = str(request.param)
    chunked = kind != "unchunked"
    compression = CompressionType[kind.upper()] if chunked else CompressionType.NONE
    path = tmp_path_factory.mktemp(kind) / "bag.mcap"
    return foreign_mcap(path, SENT, compression=compression, chunked=chunked)


def test_every_cut_gives_a_beginning_and_says_the_loss(foreign: Path, tmp_path: Path) -> None:
    whole = foreign.read_bytes()
    cut = tmp_path / "cut.mcap"
    last = 0
    for size in [*range(8, len(whole), 397), *range(len(whole) - 60, len(whole))]:
        cut.write_bytes(whole[:size])
        try:
            rows, notes = rows_of(cut)
        except RecordingError:
            assert last == 0, f"cut at {size}"
            continue
        assert rows == SENT[: len(rows)], f"cut at {size}"
        assert len(rows) >= last
        last = len(rows)
        assert "cut off" in notes[0], f"cut at {size}"
        assert f"{len(rows)} messages read" in notes[0], f"cut at {size}"
    assert last == 600


def test_a_cut_session_is_its_beginning(foreign: Path, tmp_path: Path) -> None:
    whole = foreign.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    session = read_session(cut)
    assert session.states is not None
    assert session.tracker is not None
    n = len(session.states.stamp_ns)
    assert 20 < n < 299
    np.testing.assert_array_equal(session.states.position[:, 0], np.arange(n))
    assert "cut.mcap is cut off, because its recording was not closed" in session.notes[0]
    assert "is lost" in session.notes[0]
    assert not inspect_session(cut).complete


def test_a_cut_in_the_index_loses_nothing(foreign: Path, tmp_path: Path) -> None:
    whole = foreign.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[:-60])
    session = read_session(cut)
    assert session.states is not None
    assert len(session.states.stamp_ns) == 300
    assert "all 600 messages read" in session.notes[0]


def test_zeros_at_the_end_as_after_a_power_failure(foreign: Path, tmp_path: Path) -> None:
    whole = foreign.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2] + bytes(5000))
    rows, notes = rows_of(cut)
    # Without chunks there is no checksum, so a partly written last message cannot be recognised.
    sure = rows[:-1] if "unchunked" in str(foreign) else rows
    assert len(sure) > 100
    assert sure == SENT[: len(sure)]
    assert notes


@pytest.mark.parametrize("compression", CompressionType)
def test_a_damaged_chunk_costs_only_itself(tmp_path: Path, compression: CompressionType) -> None:
    path = foreign_mcap(tmp_path / "bag.mcap", SENT, compression=compression)
    clean = len(read_messages(path)[0])
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[3]
    data = bytearray(path.read_bytes())
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    data[middle : middle + 8] = b"\xa5" * 8
    path.write_bytes(data)
    rows, notes = rows_of(path)
    assert clean - 60 < len(rows) < clean
    assert "has a damaged chunk of" in notes[0]
    assert set(rows) < set(SENT)


def test_a_damaged_first_chunk_does_not_lose_the_names(tmp_path: Path) -> None:
    # The library writes schemas and channels into the first chunk, and again at the end.
    path = foreign_mcap(tmp_path / "bag.mcap", SENT, compression=CompressionType.NONE)
    data = bytearray(path.read_bytes())
    data[300] ^= 0xFF
    path.write_bytes(data)
    session = read_session(path)
    assert session.states is not None
    assert 200 < len(session.states.stamp_ns) < 300
    assert "its checksum is wrong" in session.notes[0]


def test_damage_to_a_length_in_a_closed_file_is_not_called_a_cut(tmp_path: Path) -> None:
    path = foreign_mcap(
        tmp_path / "bag.mcap", SENT, chunked=False, compression=CompressionType.NONE
    )
    data = bytearray(path.read_bytes())
    at = data.find(SENT[40][3]) - 22 - 8  # length of the record that contains it
    data[at : at + 8] = (2**40).to_bytes(8, "little")
    path.write_bytes(data)
    messages, notes = read_messages(path)
    assert len(messages) == 40
    assert "is damaged inside: 40 messages read" in notes[0]


WRITER = """
import itertools, sys
from delta_calibration.recording import SessionWriter
from delta_calibration.recording.messages import (
    JOINT_STATE, POINT_STAMPED, encode_joint_state, encode_point)

writer = SessionWriter(sys.argv[1], {"seed": "12"})
names = ("joint_1", "joint_2", "joint_3")
for k in itertools.count():
    at = 1_700_000_000_000_000_000 + k * 1_000_000
    joints = encode_joint_state(at, names, (k, 2.0 * k, -0.5 * k))
    writer.write("/joint_states", JOINT_STATE, at, joints)
    writer.write("/tracker/point", POINT_STAMPED, at, encode_point(at, "tracker", (k, 0.0, 1.0)))
    if k % 100 == 0:
        print(k, flush=True)
"""


def test_a_writer_killed_by_sigkill_leaves_a_readable_session(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    command = [sys.executable, "-c", WRITER, str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as child:
        assert child.stdout is not None
        written = 0
        deadline = time.monotonic() + 60
        while written < 3000 and time.monotonic() < deadline:
            written = int(child.stdout.readline())
        child.send_signal(signal.SIGKILL)
        written = max([written, *(int(line) for line in child.stdout.read().split())])
    assert child.returncode == -signal.SIGKILL
    session = read_session(folder)
    assert session.states is not None
    assert session.tracker is not None
    n = len(session.states.stamp_ns)
    # A 64 KiB chunk holds fewer than 600 messages of both topics together, which may be lost.
    assert written - 300 <= n
    np.testing.assert_array_equal(session.states.position[:, 0], np.arange(n))
    np.testing.assert_array_equal(
        session.tracker.position[:, 0], np.arange(len(session.tracker.stamp_ns))
    )
    assert session.metadata == {"seed": "12"}
    assert "cut off" in session.notes[0]
    info = inspect_session(folder)
    assert not info.complete
    assert info.message_count == n + len(session.tracker.stamp_ns)


def test_a_killed_session_without_metadata_keeps_its_provenance(tmp_path: Path) -> None:
    session = make_session(np.random.default_rng(2))
    write_session(tmp_path / "s", session)
    (tmp_path / "s" / "metadata.yaml").unlink()
    file = tmp_path / "s" / "s_0.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    read = read_session(tmp_path / "s")
    assert_same_streams(read, session)
    assert read.metadata == session.metadata
    assert "metadata.yaml is missing or unreadable" in read.notes[0]


@pytest.mark.parametrize(
    "text", ["", "rosbag2_bagfile_information:\n  version: 9\n  rel", "[1", "7"]
)
def test_a_half_written_metadata_yaml_stops_nothing(tmp_path: Path, text: str) -> None:
    session = make_session(np.random.default_rng(2), 30)
    write_session(tmp_path / "s", session)
    (tmp_path / "s" / "metadata.yaml").write_text(text)
    assert_same_streams(read_session(tmp_path / "s"), session)


@pytest.mark.parametrize("storage", ["none", "lz4", "zstd", "unchunked", "sqlite"])
def test_whatever_the_damage_it_is_said_in_one_line(tmp_path: Path, storage: str) -> None:
    rng = np.random.default_rng(31)
    if storage == "sqlite":
        whole = _sqlite_file(tmp_path).read_bytes()
    else:
        chunked = storage != "unchunked"
        compression = CompressionType[storage.upper()] if chunked else CompressionType.NONE
        whole = foreign_mcap(
            tmp_path / "bag.mcap", SENT[:120], compression=compression, chunked=chunked
        ).read_bytes()
    path = tmp_path / "damaged"
    for _ in range(150):
        path.write_bytes(_damaged(whole, rng))
        for read in (read_session, read_messages, inspect_session):
            try:
                read(path)
            except RecordingError as error:  # any other exception fails the test
                said = str(error)
                assert "damaged" in said
                assert "\n" not in said


def _damaged(whole: bytes, rng: np.random.Generator) -> bytes:
    data = bytearray(whole)
    for _ in range(rng.integers(1, 6)):
        at = int(rng.integers(len(data) - 60))
        kind = rng.integers(4)
        if kind == 0:
            data[at] = rng.integers(256)
        elif kind == 1:
            data[at : at + 8] = bytes(8)
        elif kind == 2:
            data[at : at + 8] = b"\xff" * 8
        else:
            del data[at : at + int(rng.integers(1, 50))]
    return bytes(data)


def _sqlite_file(folder: Path) -> Path:
    with Writer(folder / "r", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        opened = {
            topic: writer.add_connection(topic, type_name, typestore=STORE)
            for topic, type_name in ((JOINTS, JOINT_STATE), (POINTS, POINT_STAMPED))
        }
        for topic, _, log_time, data in SENT[:120]:
            writer.write(opened[topic], log_time, data)
    return next((folder / "r").glob("*.db3"))
