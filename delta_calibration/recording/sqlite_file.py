"""Read rosbag2's older storage, one SQLite file with the tables `topics` and `messages`."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from delta_calibration.errors import RecordingError
from delta_calibration.recording.raw import RawRecording

SQLITE_MAGIC = b"SQLite format 3\0"

# The casts are for damaged files, in which a column may hold values of any type.
_TOPICS = (
    "SELECT id, CAST(name AS TEXT), CAST(type AS TEXT), CAST(serialization_format AS TEXT)"
    " FROM topics"
)
_MESSAGES = (
    "SELECT topic_id, CAST(timestamp AS INTEGER), CAST(data AS BLOB) FROM messages"
    " WHERE timestamp IS NOT NULL AND data IS NOT NULL ORDER BY timestamp, id"
)


def read_sqlite(path: Path, recording: RawRecording) -> None:
    """Add the messages of one .db3 file to a recording; of a damaged one, those before the damage.

    Raises:
        RecordingError: It has other tables, or its list of topics is damaged; the caller puts
            the file's name before the message.
    """
    before = recording.message_count
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as base:
        base.text_factory = lambda raw: raw.decode(errors="replace")
        try:
            topics = {
                key: recording.topic(name or "", type_name or "", encoding or "")
                for key, name, type_name, encoding in base.execute(_TOPICS)
            }
        except sqlite3.Error as error:
            raise RecordingError(f"cannot be read: {_line(error)}") from error
        try:
            for key, log_time, data in base.execute(_MESSAGES):
                if key not in topics:
                    continue
                topics[key].seen(log_time, log_time)
                if recording.keep(topics[key].type_name):
                    topics[key].add(log_time, data)
        except sqlite3.Error as error:
            recording.complete = False
            count = recording.message_count - before
            recording.notes.append(
                f"{path.name} is damaged ({_line(error)}): {count} messages read, the rest is lost"
            )
    recording.compressions.add("none")


def _line(error: sqlite3.Error) -> str:
    """Text of an error on one line; SQLite's errors may quote text of the file."""
    return " ".join(str(error).split())
