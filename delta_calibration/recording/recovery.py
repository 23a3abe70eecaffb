"""Rewrite a recording that was cut off as a complete one that every reader opens."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from delta_calibration.errors import InputError, RecordingError
from delta_calibration.recording.bag_metadata import LATCHED, Qos
from delta_calibration.recording.files import load_raw
from delta_calibration.recording.messages import INERTIA_STAMPED, message_type
from delta_calibration.recording.raw import RawRecording, RawTopic
from delta_calibration.recording.writer import SessionWriter

_CDR = "cdr"


@dataclass(frozen=True)
class Recovered:
    """Result of a recovery: number of messages written, and notes on what was lost."""

    messages: int
    notes: tuple[str, ...]  # what could not be read, and topics that could not be written


def recover(source: Path | str, target: Path | str) -> Recovered:
    """Write what can be read of a recording into a new one, closed and with its index.

    The messages are the same bytes at the same times, in order of arrival; the provenance goes
    with them. Topics of types that ROS 2's common interfaces lack are left out, with a note.

    Args:
        source: A recording: its folder, or a data file, whole or cut off.
        target: Folder to make.

    Raises:
        RecordingError: No message can be read.
        InputError: The folder exists, or a disk error occurs.
    """
    recording, files = load_raw(Path(source), lambda _: True)
    topics, left_out = _writable(recording)
    rows = sorted(
        (time_ns, k, row)
        for k, topic in enumerate(topics)
        for row, time_ns in enumerate(topic.log_time_ns)
    )
    notes = (*files.notes, *recording.notes, *left_out)
    if not rows:
        raise RecordingError("; ".join([f"{source}: no message can be recovered", *notes]))
    with SessionWriter(target, {**recording.metadata, **files.custom_data}) as writer:
        for topic in topics:
            qos = LATCHED if topic.type_name == INERTIA_STAMPED else Qos()
            writer.add_topic(topic.name, topic.type_name, (qos,))
        for time_ns, k, row in rows:
            writer.write(topics[k].name, topics[k].type_name, time_ns, topics[k].records[row])
    return Recovered(len(rows), notes)


def _writable(recording: RawRecording) -> tuple[list[RawTopic], list[str]]:
    """Topics that can be written, and why the others cannot."""
    topics, notes = [], []
    for topic in recording.topics.values():
        try:
            if topic.encoding != _CDR:
                raise InputError(f"its messages are {topic.encoding!r}, not {_CDR!r}")
            message_type(topic.type_name)
        except InputError as error:
            notes.append(f"{topic.name}: {topic.count} messages left out: {error}")
        else:
            topics.append(topic)
    return topics, notes
