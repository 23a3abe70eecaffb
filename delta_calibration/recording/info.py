"""Summary of a recording, from its index if it has one, else by reading its messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Channel, ChunkIndex, Schema, Statistics

from delta_calibration.errors import RecordingError
from delta_calibration.recording.files import is_sqlite, load_raw, locate, open_data
from delta_calibration.recording.layout import UndecodableError, layout_of
from delta_calibration.recording.mcap_file import read_provenance, read_summary
from delta_calibration.recording.messages import JOINT_STATE
from delta_calibration.recording.raw import RawRecording


@dataclass(frozen=True)
class TopicInfo:
    """One recorded topic."""

    name: str
    type_name: str
    count: int
    rate_hz: float  # messages over the duration of the recording; 0 where that is zero


@dataclass(frozen=True)
class SessionInfo:
    """Facts about a recording."""

    source: str
    files: tuple[str, ...]
    storage: str  # "mcap" or "sqlite3"
    compression: str  # of the chunks
    chunks: int
    size_bytes: int
    start_ns: int  # [ns] earliest time of arrival
    duration_s: float
    message_count: int
    topics: tuple[TopicInfo, ...]
    custom_data: Mapping[str, str]
    complete: bool  # whether every file was closed by its writer
    notes: tuple[str, ...]


def inspect_session(path: Path | str) -> SessionInfo:
    """Summarise a recording.

    Args:
        path: Its folder, the `metadata.yaml` in it, or a bare data file.

    Raises:
        RecordingError: There is no recording.
    """
    source = Path(path)
    files = locate(source)
    recording = RawRecording(_nothing)
    try:
        indexed = all([_read_index(file, recording) for file in files.data])
        size = sum(file.stat().st_size for file in files.data)
        storage = _storage(files.data[0])
    except RecordingError as error:
        raise RecordingError(f"{source} {error}") from error
    except (OSError, ValueError) as error:
        raise RecordingError(f"{source} cannot be read: {error}") from error
    if not indexed:
        recording, files = load_raw(source, _nothing)
    topics = [topic for topic in recording.topics.values() if topic.count]
    start = min((topic.first_ns for topic in topics), default=0)
    duration = (max((topic.last_ns for topic in topics), default=0) - start) / 1e9
    return SessionInfo(
        source=str(source),
        files=tuple(file.name for file in files.data),
        storage=storage,
        compression=", ".join(sorted(recording.compressions)) or "none",
        chunks=recording.chunks,
        size_bytes=size,
        start_ns=start,
        duration_s=duration,
        message_count=recording.message_count,
        topics=tuple(
            TopicInfo(t.name, t.type_name, t.count, t.count / duration if duration else 0.0)
            for t in sorted(recording.topics.values(), key=lambda topic: topic.name)
        ),
        custom_data={**recording.metadata, **files.custom_data},
        complete=recording.complete,
        notes=(*files.notes, *recording.notes),
    )


def joints_in(path: Path | str) -> dict[str, tuple[str, ...]]:
    """Names of the joints in each topic of joint states, as its first readable message has them.

    Args:
        path: of the recording; all its joint states are read.

    Raises:
        RecordingError: There is no recording.
    """
    recording, _ = load_raw(Path(path), JOINT_STATE.__eq__)
    return {
        topic.name: next((names for names in map(_names, topic.records) if names), ())
        for topic in sorted(recording.topics.values(), key=lambda topic: topic.name)
        if topic.type_name == JOINT_STATE and topic.count
    }


def _names(record: bytes) -> tuple[str, ...]:
    """Joint names of one message; empty if it cannot be decoded."""
    try:
        return layout_of(record, JOINT_STATE).names
    except UndecodableError:
        return ()


def _nothing(_: str) -> bool:
    return False


def _storage(file: Path) -> str:
    with open_data(file) as stream:
        return "sqlite3" if is_sqlite(stream) else "mcap"


def _read_index(file: Path, recording: RawRecording) -> bool:
    """Add the index at the end of an MCAP file; False if there is no valid one."""
    with open_data(file) as stream:
        if is_sqlite(stream):
            return False
        summary = read_summary(stream)
        recording.metadata.update(read_provenance(stream, summary))
    statistics = next((r for r in summary if isinstance(r, Statistics)), None)
    if statistics is None:
        return False
    schemas = {r.id: r.name for r in summary if isinstance(r, Schema)}
    for channel in (r for r in summary if isinstance(r, Channel)):
        recording.topic(
            channel.topic, schemas.get(channel.schema_id, ""), channel.message_encoding
        ).seen(
            statistics.message_start_time,
            statistics.message_end_time,
            statistics.channel_message_counts.get(channel.id, 0),
        )
    chunks = [r for r in summary if isinstance(r, ChunkIndex)]
    recording.chunks += len(chunks)
    recording.compressions.update(chunk.compression or "none" for chunk in chunks)
    return True
