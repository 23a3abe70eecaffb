"""Recovered recordings can be opened by every reader, and no message is added or changed."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from delta_calibration.cli.main import run
from delta_calibration.errors import InputError, RecordingError
from delta_calibration.recording import SessionWriter, inspect_session, read_messages
from delta_calibration.recording.recovery import recover
from recording_helpers import foreign_mcap
from test_recording_salvage import SENT


def cut(folder: Path) -> Path:
    """A session of a killed recorder, with chunks but without an index."""
    writer = SessionWriter(folder, {"machine": "seven"})
    for row in SENT:
        writer.write(row[0], row[1], row[2], row[3])
    writer.sync()
    writer._abandon()
    return folder


def test_a_cut_recording_is_recovered_for_every_reader(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = cut(tmp_path / "cut"), tmp_path / "whole"
    (file,) = source.glob("*.mcap")
    with file.open("rb") as stream, pytest.raises(McapError):
        make_reader(stream).get_summary()
    assert run(["recover", str(source), "--out", str(target)]) == 0
    said = capsys.readouterr().out
    assert "cut off" in said
    assert f"{len(SENT)} messages written" in said
    with AnyReader([target]) as reader:
        theirs = [(c.topic, time, bytes(data)) for c, time, data in reader.messages()]
    assert theirs == [(topic, time, data) for topic, _, time, data in SENT]
    (file,) = target.glob("*.mcap")
    with file.open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) == len(SENT)
    info = inspect_session(target)
    assert info.complete
    assert info.custom_data["machine"] == "seven"


def test_a_file_torn_anywhere_gives_its_beginning(tmp_path: Path) -> None:
    whole = foreign_mcap(tmp_path / "bag.mcap", SENT).read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole[: len(whole) // 2])
    found = recover(torn, tmp_path / "out")
    messages, notes = read_messages(tmp_path / "out")
    assert 0 < found.messages == len(messages) < len(SENT)
    assert [m.data for m in messages] == [row[3] for row in SENT[: len(messages)]]
    assert not notes
    assert "cut off" in found.notes[0]


def test_what_cannot_be_recovered_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = foreign_mcap(tmp_path / "empty.mcap", [])
    with pytest.raises(RecordingError, match="no message can be recovered"):
        recover(empty, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    source = cut(tmp_path / "cut")
    with pytest.raises(InputError, match="exists already"):
        recover(source, source)
    assert run(["recover", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")]) == 2
    assert "Traceback" not in capsys.readouterr().err
