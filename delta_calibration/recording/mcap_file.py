"""Read MCAP files from front to back, up to the point where an incomplete file ends.

The index at the end of a file is not needed for the messages: a file whose writer was killed has
none. Records are walked in order of the file: `opcode (1), length (8), content`. Chunks hold
records of the same form. Torn or damaged records are left out and reported in a note.
"""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    Footer,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
)
from mcap.stream_reader import StreamReader

from delta_calibration.errors import RecordingError
from delta_calibration.recording.raw import RawRecording, RawTopic

MAGIC = b"\x89MCAP0\r\n"
PROVENANCE = "delta_calibration"  # name of the MCAP metadata record that carries custom_data

_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_BODY = _MESSAGE_HEAD.size
_READ_WHOLE = frozenset(
    (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA)
)
_FOOTER_BYTES = 9 + 20 + len(MAGIC)
_LARGEST_CHUNK = 1 << 29  # bytes; a larger length is damage, not a chunk
_LARGEST_UNPACKED = 1 << 28  # bytes of an unpacked chunk at most; writers make about 1 MB
_LARGEST_WINDOW = 1 << 27  # bytes of zstd's window at most, which is its own default limit
_PART = 1 << 22
# Exceptions that reading damaged data raises; bad UTF-8 is a ValueError.
_BROKEN = (McapError, struct.error, ValueError, OverflowError, MemoryError)


def read_mcap(stream: BinaryIO, name: str, recording: RawRecording) -> None:
    """Add the messages of one MCAP file to a recording.

    Args:
        stream: The file, seekable.
        name: Name of the file in notes to the user.
        recording: Takes the topics, provenance and notes.

    Raises:
        RecordingError: Empty, not an MCAP file, or a compression that is not supported; the
            caller puts the file's name before the message.
    """
    _Scan(stream, name, recording).run()


def decompress(data: bytes, compression: str, most: int) -> bytes:
    """Unpack a chunk; of a torn chunk, as much as can be recovered.

    Args:
        data: bytes in the file.
        compression: "zstd", "lz4" or "" for none.
        most: bytes that they may unpack to.

    Raises:
        RecordingError: Unknown compression.
        ValueError: The data is damaged, or unpacks to more than `most` bytes.
    """
    if compression == "zstd":
        try:
            plain = _unpacked(data, most + 1)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
        return _no_more(plain, most)
    if compression == "lz4":
        try:
            plain = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most + 1)
        except RuntimeError as error:
            raise ValueError(str(error)) from error
        return _no_more(plain, most)
    if compression:
        raise RecordingError(
            f"has chunks compressed by {compression!r}: none, lz4 and zstd can be read"
        )
    return data


def _unpacked(data: bytes, most: int) -> bytes:
    """Unpack zstd data up to their end or a tear, `most` bytes at most."""
    parts, left = [], most
    with zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).stream_reader(data) as reader:
        while left and (part := reader.read(min(left, _PART))):
            parts.append(part)
            left -= len(part)
    return b"".join(parts)


def _no_more(plain: bytes, most: int) -> bytes:
    if len(plain) > most:
        raise ValueError(f"it unpacks to more than {most} bytes")
    return plain


def _what_then(name: str) -> str:
    """Hint for the user if the file's name is not that of a recording, else empty."""
    if name.lower().endswith((".csv", ".txt")):
        return "; `delta-cal import` converts tables into sessions"
    if ".mcap" in name:
        return ""
    return "; a session is a folder with .mcap or .db3 files, or one of them"


class _Scan:
    """One pass over one file."""

    def __init__(self, stream: BinaryIO, name: str, recording: RawRecording) -> None:
        self._stream = stream
        self._name = name
        self._recording = recording
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, RawTopic] = {}
        self._size = stream.seek(0, 2)
        self._before = recording.message_count
        self._torn = 0  # messages saved from a torn chunk
        self._data_ended = False

    def run(self) -> None:
        self._stream.seek(0)
        if not self._size:
            raise RecordingError("is empty (0 bytes)")
        if self._stream.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"is not an MCAP file{_what_then(self._name)}")
        while True:
            head = self._stream.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return self._say_cut_off()
            opcode, length = _HEAD.unpack(head)
            if opcode == Opcode.FOOTER and self._closed():
                return None
            self._data_ended |= opcode == Opcode.DATA_END
            left = self._size - self._stream.tell()
            whole = length <= left and opcode != 0
            if opcode in _READ_WHOLE and length <= _LARGEST_CHUNK:
                self._record(opcode, self._stream.read(min(length, left)), whole)
            elif whole:
                self._stream.seek(length, 1)
            if not whole:
                return self._say_cut_off()

    def _record(self, opcode: int, body: bytes, whole: bool) -> None:
        if opcode == Opcode.CHUNK:
            self._chunk(body, whole)
        elif whole:
            try:
                self._small_record(opcode, body, 0, len(body))
            except _BROKEN as error:
                self._say(f"has a damaged record, left out ({error})")

    def _chunk(self, body: bytes, whole: bool) -> None:
        start = self._recording.message_count
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
        except _BROKEN as error:
            if whole:
                self._say(f"has a damaged chunk, left out ({error})")
            return
        self._recording.chunks += 1
        self._recording.compressions.add(chunk.compression or "none")
        try:
            if chunk.uncompressed_size > _LARGEST_UNPACKED:
                raise ValueError(
                    f"{chunk.uncompressed_size} bytes; no chunk has more than {_LARGEST_UNPACKED}"
                )
            data = decompress(chunk.data, chunk.compression, chunk.uncompressed_size)
            if whole:
                _check(chunk, data)
            self._chunk_records(data)
        except _BROKEN as error:
            if whole:
                lost = f"{(chunk.message_end_time - chunk.message_start_time) / 1e9:.3g} s"
                self._say(f"has a damaged chunk of {lost}, left out ({error})")
        if not whole:
            self._torn = self._recording.message_count - start

    def _chunk_records(self, data: bytes) -> None:
        offset, size = 0, len(data)
        unpack_head, unpack_message = _HEAD.unpack_from, _MESSAGE_HEAD.unpack_from
        message_opcode = int(Opcode.MESSAGE)
        kept: dict[int, tuple[RawTopic, bool]] = {}
        while offset + _HEAD.size <= size:
            opcode, length = unpack_head(data, offset)
            start = offset + _HEAD.size
            offset = start + length
            if offset > size:
                return
            if opcode != message_opcode:
                self._small_record(opcode, data, start, offset)
                continue
            channel, _, log_time, _ = unpack_message(data, start)
            if channel not in kept:
                topic = self._topic(channel)
                kept[channel] = topic, self._recording.keep(topic.type_name)
            topic, wanted = kept[channel]
            topic.seen(log_time, log_time)
            if wanted:
                topic.add(log_time, data[start + _BODY : offset])

    def _small_record(self, opcode: int, data: bytes, start: int, stop: int) -> None:
        """A schema, channel, message or metadata record that lies in `data[start:stop]`."""
        stream = ReadDataStream(BytesIO(data[start:stop]))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema.name
        elif opcode == Opcode.CHANNEL:
            self._add_channel(Channel.read(stream))
        elif opcode == Opcode.MESSAGE:
            message = Message.read(stream, stop - start)
            topic = self._topic(message.channel_id)
            topic.seen(message.log_time, message.log_time)
            if self._recording.keep(topic.type_name):
                topic.add(message.log_time, message.data)
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            if metadata.name == PROVENANCE:
                self._recording.metadata.update(metadata.metadata)

    def _topic(self, channel: int) -> RawTopic:
        """Topic of a channel; from the file's summary if the chunk that names it is lost."""
        if channel not in self._channels:
            for record in read_summary(self._stream):
                if isinstance(record, Schema):
                    self._schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    self._add_channel(record)
        if channel not in self._channels:
            raise ValueError(f"channel {channel} is not described")
        return self._channels[channel]

    def _add_channel(self, channel: Channel) -> None:
        self._channels[channel.id] = self._recording.topic(
            channel.topic, self._schemas.get(channel.schema_id, ""), channel.message_encoding
        )

    def _say_cut_off(self) -> None:
        self._recording.complete = False
        count = self._recording.message_count - self._before
        if self._data_ended:
            return self._say(f"is cut off in its index: all {count} messages read")
        torn = (
            f", {self._torn} of them from an incomplete chunk; the rest of that chunk and "
            "everything"
            if self._torn
            else "; everything"
        )
        what = (
            "damaged inside"
            if self._closed()
            else ("cut off, because its recording was not closed")
        )
        return self._say(
            f"is {what}: {count} messages read{torn} after the last whole chunk is lost"
        )

    def _closed(self) -> bool:
        """Whether the file ends with the MCAP magic, which only a properly closed file has."""
        position = self._stream.tell()
        self._stream.seek(max(len(MAGIC), self._size - len(MAGIC)))
        end = self._stream.read()
        self._stream.seek(position)
        return end == MAGIC

    def _say(self, what: str) -> None:
        self._recording.notes.append(f"{self._name} {what}")


def read_summary(stream: BinaryIO) -> tuple[McapRecord, ...]:
    """Records of the summary at a file's end; empty if there is no valid one."""
    position = stream.tell()
    try:
        stream.seek(-_FOOTER_BYTES, 2)
        tail = StreamReader(stream, skip_magic=True)
        footer = next(iter(tail.records))
        if not isinstance(footer, Footer) or not footer.summary_start:
            return ()
        stream.seek(footer.summary_start)
        return tuple(StreamReader(stream, skip_magic=True).records)
    except (*_BROKEN, OSError, StopIteration):
        return ()
    finally:
        stream.seek(position)


def read_provenance(stream: BinaryIO, summary: tuple[McapRecord, ...]) -> dict[str, str]:
    """Key-value pairs of the provenance record that the summary points to, if there is one."""
    found: dict[str, str] = {}
    for index in summary:
        if isinstance(index, MetadataIndex) and index.name == PROVENANCE:
            stream.seek(index.offset + _HEAD.size)
            try:
                found.update(Metadata.read(ReadDataStream(stream)).metadata)
            except _BROKEN:
                continue
    return found


def _check(chunk: Chunk, data: bytes) -> None:
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"{len(data)} bytes, not the {chunk.uncompressed_size} it should have")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("its checksum is wrong")
