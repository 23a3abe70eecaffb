"""Read a session: the streams of any rosbag2 recording of a cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from delta_calibration.data.streams import JointStream, Session, TrackerStream
from delta_calibration.errors import RecordingError
from delta_calibration.recording.decoded import (
    joint_stream,
    payload_stream,
    temperature_streams,
    tracker_stream,
)
from delta_calibration.recording.files import load_raw
from delta_calibration.recording.layout import DECODABLE
from delta_calibration.recording.messages import (
    INERTIA_STAMPED,
    JOINT_STATE,
    POINT_STAMPED,
    POSE_STAMPED,
    TEMPERATURE,
)
from delta_calibration.recording.raw import RawRecording, RawTopic
from delta_calibration.recording.topics import DEFAULT_TOPICS, Topics, listing

_Stream = TypeVar("_Stream")

_TYPES = {
    "command": JOINT_STATE,
    "states": JOINT_STATE,
    "tracker_pose": POSE_STAMPED,
    "tracker_point": POINT_STAMPED,
    "temperature": TEMPERATURE,
    "payload": INERTIA_STAMPED,
}


def read_session(
    path: Path | str, topics: Topics = DEFAULT_TOPICS, *, partial: bool = False
) -> Session:
    """Read the streams of a recording.

    Args:
        path: Folder of the recording, the `metadata.yaml` in it, or a bare .mcap or .db3 file.
        topics: Name of the topic of each stream.
        partial: Accept a recording without joint angles or without tracker readings.

    Returns:
        Its streams, each in order of its stamps; `notes` say what was lost, left out or chosen.

    Raises:
        RecordingError: Not a readable recording, a topic of another type, no joint angles
            (command or states), or no tracker readings.
    """
    recording, files = load_raw(Path(path), DECODABLE.__contains__)
    assembly = _Assembly(recording, topics)
    metadata = {**recording.metadata, **files.custom_data}
    try:
        session = assembly.session(str(path), metadata, partial)
    except RecordingError as error:
        said = "".join(f"; {note}" for note in (*recording.notes, *assembly.notes))
        raise RecordingError(f"{path}: {error}{said}") from None
    notes = (*files.notes, *recording.notes, *assembly.notes, session.clock_note)
    return replace(session, notes=tuple(filter(None, notes)))


@dataclass(frozen=True)
class RawMessage:
    """A recorded message in its serialised form."""

    topic: str
    type_name: str
    log_time_ns: int  # [ns] when it arrived
    data: bytes  # CDR, encapsulation first


def read_messages(path: Path | str) -> tuple[tuple[RawMessage, ...], tuple[str, ...]]:
    """All messages of a recording, of all topics, in order of arrival; for a player.

    Returns:
        The messages, and notes on what could not be read.

    Raises:
        RecordingError: Not a readable recording, or one without messages.
    """
    recording, files = load_raw(Path(path), lambda _: True)
    messages = [
        RawMessage(topic.name, topic.type_name, log_time, data)
        for topic in recording.topics.values()
        for log_time, data in zip(topic.log_time_ns, topic.records, strict=True)
    ]
    if not messages:
        said = "".join(f"; {note}" for note in recording.notes)
        raise RecordingError(f"{path}: the recording contains no messages{said}")
    messages.sort(key=lambda message: message.log_time_ns)
    return tuple(messages), (*files.notes, *recording.notes)


class _Assembly:
    """Builds the streams of one recording, and collects notes on the way."""

    def __init__(self, recording: RawRecording, topics: Topics) -> None:
        self._recording = recording
        self._topics = topics
        self.notes: list[str] = []

    def session(self, source: str, metadata: dict[str, str], partial: bool) -> Session:
        if not self._recording.message_count:
            raise RecordingError("the recording contains no messages")
        command = self._joints("command", None)
        states = self._joints("states", command.names if command else None)
        tracker = self._tracker()
        if not (command or states or partial):
            raise self._missing("joint angles", "command", "states")
        if not (tracker or partial):
            raise self._missing("tracker readings", "tracker_pose", "tracker_point")
        temperature, payload = self._raw("temperature"), self._raw("payload")
        return Session(
            source=source,
            command=command,
            states=states,
            tracker=tracker,
            temperature=self._noted(temperature_streams(temperature)) if temperature else (),
            payload=self._noted(payload_stream(payload)) if payload else None,
            metadata=metadata,
        )

    def _joints(self, stream: str, wanted: tuple[str, ...] | None) -> JointStream | None:
        raw = self._raw(stream)
        return self._noted(joint_stream(raw, wanted)) if raw else None

    def _tracker(self) -> TrackerStream | None:
        """Tracker poses if there are any, else points; points first if only they are named."""
        streams = ["tracker_pose", "tracker_point"]
        asked = [s for s in streams if getattr(self._topics, s) != getattr(DEFAULT_TOPICS, s)]
        if asked == ["tracker_point"]:
            streams.reverse()
        raws = [raw for raw in map(self._raw, streams) if raw]
        for raw in raws:
            tracker = self._noted(tracker_stream(raw))
            if tracker:
                if len(raws) == 2:
                    other = raws[1 - raws.index(raw)].name
                    left = streams[raws.index(raw)]
                    self.notes.append(
                        f"{raw.name} is used, {other} is not (--topic {left}= reverses this)"
                    )
                return tracker
        return None

    def _raw(self, stream: str) -> RawTopic | None:
        """Messages of a stream's topic; None if there are none."""
        topics = self._recording.topics.values()
        name = self._topics.find(stream, [topic.name for topic in topics])
        if name is None:
            return None
        named = [topic for topic in topics if topic.name == name]
        right = [t for t in named if (t.type_name, t.encoding) == (_TYPES[stream], "cdr")]
        if not right:
            found = named[0].type_name or "of no stated type"
            raise RecordingError(
                f"{name} is {found} ({named[0].encoding}), not {_TYPES[stream]} (cdr):"
                f" --topic {stream}=NAME names another, --topic {stream}= leaves it out"
            )
        if not right[0].count:
            self.notes.append(f"{name} has no messages")
            return None
        return right[0]

    def _noted(self, result: tuple[_Stream, tuple[str, ...]]) -> _Stream:
        stream, notes = result
        self.notes.extend(notes)
        return stream

    def _missing(self, what: str, *streams: str) -> RecordingError:
        wanted = " or ".join(getattr(self._topics, stream) or "(left out)" for stream in streams)
        names = listing(topic.name for topic in self._recording.topics.values())
        return RecordingError(
            f"no {what}: expected {wanted}, recorded are {names}; {self._where(streams)}"
        )

    def _where(self, streams: Sequence[str]) -> str:
        """Hint which --topic option to give, with the recorded topics of a stream's type."""
        fitting: dict[str, str] = {}  # topic: the first stream that has its type
        for stream in streams:
            for topic in self._recording.topics.values():
                if topic.type_name == _TYPES[stream]:
                    fitting.setdefault(topic.name, stream)
        options = [f"--topic {stream}={name}" for name, stream in sorted(fitting.items())]
        if not options:
            return f"--topic {streams[0]}=NAME says where they are"
        return f"of that type: {' or '.join(options)}"
