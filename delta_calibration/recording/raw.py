"""Content of a recording before decoding: message bytes and times of arrival of each topic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

Keep = Callable[[str], bool]  # whether messages of a type are kept, or only counted


@dataclass
class RawTopic:
    """Messages of one topic, gathered while its files are scanned."""

    name: str
    type_name: str
    encoding: str = "cdr"
    count: int = 0
    first_ns: int = 0  # earliest time of arrival
    last_ns: int = 0  # latest time of arrival
    log_time_ns: list[int] = field(default_factory=list)
    records: list[bytes] = field(default_factory=list)

    def seen(self, first_ns: int, last_ns: int, count: int = 1) -> None:
        """Count messages that arrived between these times."""
        if not count:
            return
        self.first_ns = min(self.first_ns, first_ns) if self.count else first_ns
        self.last_ns = max(self.last_ns, last_ns) if self.count else last_ns
        self.count += count

    def add(self, log_time_ns: int, record: bytes) -> None:
        """Keep a message."""
        self.log_time_ns.append(log_time_ns)
        self.records.append(record)


@dataclass
class RawRecording:
    """All topics of a recording, gathered over its files; `notes` say what could not be read."""

    keep: Keep
    topics: dict[tuple[str, str, str], RawTopic] = field(default_factory=dict)
    metadata: dict[str, str] = field(default_factory=dict)  # provenance found inside the files
    notes: list[str] = field(default_factory=list)
    compressions: set[str] = field(default_factory=set)
    chunks: int = 0
    complete: bool = True  # False where a file was cut off

    def topic(self, name: str, type_name: str, encoding: str) -> RawTopic:
        """Topic of this name, type and encoding; created if it is new."""
        key = (name, type_name, encoding)
        return self.topics.setdefault(key, RawTopic(*key))

    @property
    def message_count(self) -> int:
        """Messages read so far."""
        return sum(topic.count for topic in self.topics.values())
