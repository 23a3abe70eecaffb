"""Write a session: a rosbag2 folder with one MCAP file that stays readable if its writer dies.

A chunk of messages is finished at 64 KiB or after a second, whichever comes first, and handed to
the operating system at once; about once a second it is forced to the disk. So a killed writer
loses the unfinished chunk only, and a power failure about one second.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from delta_calibration import __version__
from delta_calibration.errors import InputError
from delta_calibration.recording.bag_metadata import (
    FILE_NAME,
    Qos,
    TopicEntry,
    dump_yaml,
    metadata_text,
    replace_file,
)
from delta_calibration.recording.mcap_file import PROVENANCE
from delta_calibration.recording.messages import message_type

_CHUNK_BYTES = 64 * 1024
_NO_LIMIT = 1 << 62  # the writer below decides when a chunk ends
_MESSAGE_OVERHEAD = 31  # bytes of an MCAP message record besides its data
_SYNC_S = 1.0  # between forced writes to disk
_COMPRESSIONS = {"none": CompressionType.NONE, "zstd": CompressionType.ZSTD}


class SessionWriter:
    """Writes serialised messages into a new recording.

    Opens its files at once; is its own context manager. Not thread-safe.

    Args:
        path: Folder to make; it must not exist, or be empty.
        metadata: Provenance to store, as rosbag2's `custom_data`.
        compression: Of the chunks, "zstd" (a third of the size, at no cost in time) or "none".

    Raises:
        InputError: The folder is not empty, or can't be written.
    """

    def __init__(
        self,
        path: Path | str,
        metadata: Mapping[str, str] | None = None,
        *,
        compression: str = "zstd",
    ) -> None:
        if compression not in _COMPRESSIONS:
            raise InputError(
                f"compression {compression!r}: {' or '.join(_COMPRESSIONS)} is needed"
            )
        self.path = Path(path)
        self._metadata = {str(key): str(value) for key, value in (metadata or {}).items()}
        self._channels: dict[str, int] = {}  # topic: MCAP channel
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, TopicEntry] = {}
        self._counts: dict[str, int] = {}
        self._span_ns: tuple[int, int] | None = None
        self._pending = 0  # bytes in the unfinished chunk
        self._synced = time.monotonic()
        self._closed = False
        self._open(_COMPRESSIONS[compression])

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close in any case: what was recorded before a failure is worth having."""
        self.close()

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return sum(self._counts.values())

    def add_topic(self, topic: str, type_name: str, qos: Sequence[Qos] = ()) -> None:
        """Announce a topic and its publishers' QoS; without it, the first message announces it.

        Raises:
            InputError: No name, an unknown type, or the topic exists with another type.
        """
        self._require_open()
        if topic in self._topics:
            known = self._topics[topic].type_name
            if known != type_name:
                raise InputError(f"{topic} is recorded as {known}, not {type_name}")
            return
        if not topic:
            raise InputError("a topic without a name cannot be recorded")
        described = message_type(type_name)
        with self._disk():
            if type_name not in self._schemas:
                self._schemas[type_name] = self._writer.register_schema(
                    type_name, "ros2msg", described.definition.encode()
                )
            self._channels[topic] = self._writer.register_channel(
                topic,
                "cdr",
                self._schemas[type_name],
                {
                    "offered_qos_profiles": dump_yaml([q.entries() for q in qos]).strip(),
                    "topic_type_hash": described.hash,
                },
            )
            self._topics[topic] = TopicEntry(topic, type_name, described.hash, tuple(qos), 0)
            self._counts[topic] = 0
            self._write_metadata()

    def write(
        self,
        topic: str,
        type_name: str,
        log_time_ns: int,
        data: bytes,
        publish_time_ns: int | None = None,
    ) -> None:
        """Record a message.

        Args:
            topic: Its topic.
            type_name: Its type, `package/msg/Name`.
            log_time_ns: When it arrived [ns].
            data: Its CDR bytes, encapsulation first.
            publish_time_ns: When it was sent [ns]; by default when it arrived.

        Raises:
            InputError: A disk error, a changed type, a negative time, or the recording is closed.
        """
        if topic not in self._channels or self._topics[topic].type_name != type_name:
            self.add_topic(topic, type_name)
        self._require_open()
        log_time_ns = int(log_time_ns)
        publish_time_ns = log_time_ns if publish_time_ns is None else int(publish_time_ns)
        if log_time_ns < 0 or publish_time_ns < 0:
            raise InputError(f"{topic}: time {min(log_time_ns, publish_time_ns)} ns is negative")
        data = bytes(data)
        try:
            self._writer.add_message(
                self._channels[topic], log_time_ns, data, publish_time_ns, self._counts[topic]
            )
        except BaseException:  # Ctrl-C between two bytes of a record: that chunk can't be finished
            self._abandon()
            raise
        self._counts[topic] += 1
        first, last = self._span_ns or (log_time_ns, log_time_ns)
        self._span_ns = (min(first, log_time_ns), max(last, log_time_ns))
        self._pending += _MESSAGE_OVERHEAD + len(data)
        if time.monotonic() - self._synced >= _SYNC_S:
            self.sync()
        elif self._pending >= _CHUNK_BYTES:
            with self._disk():
                self._flush()

    def sync(self) -> None:
        """Force all written messages to the disk; a recorder calls it while nothing arrives.

        Raises:
            InputError: A disk error, or the file was moved or deleted while it was open, which
                the operating system does not report.
        """
        self._require_open()
        with self._disk():
            self._require_there()
            self._flush()
            os.fsync(self._stream.fileno())
        self._synced = time.monotonic()

    def close(self) -> None:
        """Write the index and the final `metadata.yaml`. A second call does nothing.

        Raises:
            InputError: A disk error.
        """
        if self._closed:
            return
        with self._disk():
            self._flush()
            own = self._described(rooted=False)
            self._writer.add_metadata("rosbag2", {"serialized_metadata": own})
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._stream.flush()
            os.fsync(self._stream.fileno())
            self._write_metadata(final=True)
            self._closed = True
            self._stream.close()

    def _open(self, compression: CompressionType) -> None:
        name = f"{self.path.resolve().name}_0.mcap"
        try:
            if self.path.exists() and not (self.path.is_dir() and not any(self.path.iterdir())):
                raise InputError(f"{self.path} exists already: a recording is never overwritten")
            self.path.mkdir(parents=True, exist_ok=True)
            self._stream = (self.path / name).open("xb")
        except OSError as error:
            raise InputError(
                f"{self.path}: a recording cannot be made there: {error.strerror or error}"
            ) from error
        self._file = name
        self._writer = Writer(self._stream, chunk_size=_NO_LIMIT, compression=compression)
        with self._disk():
            self._writer.start(profile="ros2", library=f"delta_calibration {__version__}")
            if self._metadata:
                # In the data file too, because it may be copied without its metadata.yaml.
                self._writer.add_metadata(PROVENANCE, self._metadata)
            self._stream.flush()
            self._write_metadata()

    def _flush(self) -> None:
        """Finish the current chunk and hand it to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._pending = 0

    def _described(self, *, rooted: bool = True) -> str:
        topics = [
            TopicEntry(t.name, t.type_name, t.type_hash, t.qos, self._counts[t.name])
            for t in self._topics.values()
        ]
        return metadata_text(self._file, topics, self._span_ns, self._metadata, rooted=rooted)

    def _write_metadata(self, *, final: bool = False) -> None:
        replace_file(self.path / FILE_NAME, self._described(), on_disk=final)

    def _require_there(self) -> None:
        """Check that the path still names the open file.

        Raises:
            InputError: The file was moved or deleted.
        """
        mine = os.fstat(self._stream.fileno())
        with contextlib.suppress(OSError):
            there = (self.path / self._file).stat()
            if (there.st_dev, there.st_ino) == (mine.st_dev, mine.st_ino):
                return
        what = "was moved away" if mine.st_nlink else "was deleted, and is lost"
        raise InputError(
            f"{self.path}: the recording {what} while it was written, "
            f"after {self.message_count} messages"
        )

    def _require_open(self) -> None:
        if self._closed:
            raise InputError(f"{self.path}: the recording is closed")

    @contextlib.contextmanager
    def _disk(self) -> Iterator[None]:
        """Turn disk errors into `InputError`; after any error nothing more is written."""
        try:
            yield
        except BaseException as error:
            self._abandon()
            if isinstance(error, OSError):
                raise InputError(
                    f"{self.path}: writing failed after {self.message_count} messages:"
                    f" {error.strerror or error}; what was on disk before stays readable"
                ) from error
            raise

    def _abandon(self) -> None:
        """Leave the file as a killed writer would: whole chunks, no index."""
        self._closed = True
        with contextlib.suppress(OSError):
            self._stream.close()
