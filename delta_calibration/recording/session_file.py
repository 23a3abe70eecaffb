"""Write a whole session at once, as a simulator does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delta_calibration.data.streams import (
    JointStream,
    PayloadStream,
    Session,
    Stamps,
    TemperatureStream,
    TrackerStream,
)
from delta_calibration.errors import InputError
from delta_calibration.recording.bag_metadata import LATCHED, Qos
from delta_calibration.recording.messages import (
    INERTIA_STAMPED,
    JOINT_STATE,
    POINT_STAMPED,
    POSE_STAMPED,
    TEMPERATURE,
    encode_joint_state,
    encode_payload,
    encode_point,
    encode_pose,
    encode_temperature,
)
from delta_calibration.recording.writer import SessionWriter

TRACKER_FRAME = "tracker"
PLATFORM_FRAME = "tool0"


@dataclass(frozen=True)
class _Source:
    """A stream to be written: topic, message type, stamps and encoder of its rows."""

    topic: str
    type_name: str
    stamp_ns: Stamps  # (n,) [ns]
    encode: Callable[[int], bytes]  # row -> message
    qos: tuple[Qos, ...] = (Qos(),)


def write_session(
    path: Path | str, session: Session, metadata: Mapping[str, str] | None = None
) -> None:
    """Write the streams of a session as one recording, in order of their stamps.

    Args:
        path: Folder to make.
        session: What to write; its notes are not kept.
        metadata: Provenance in addition to the session's own, which it overrides.

    Raises:
        InputError: The folder exists, a disk error, or a stream whose arrays do not fit together.
    """
    sources = list(_sources(session))
    for source in sources:
        if np.any(source.stamp_ns < 0):
            raise InputError(f"{source.topic}: stamp {source.stamp_ns.min()} ns is negative")
    which = np.repeat(np.arange(len(sources)), [s.stamp_ns.size for s in sources])
    row = np.concatenate([np.arange(s.stamp_ns.size) for s in sources] or [np.empty(0, int)])
    stamp_ns = np.concatenate([s.stamp_ns for s in sources] or [np.empty(0, np.int64)])
    order = np.argsort(stamp_ns, kind="stable")
    with SessionWriter(path, {**session.metadata, **(metadata or {})}) as writer:
        for source in sources:
            writer.add_topic(source.topic, source.type_name, source.qos)
        for i, k, stamp in zip(
            which[order].tolist(), row[order].tolist(), stamp_ns[order].tolist(), strict=True
        ):
            source = sources[i]
            writer.write(source.topic, source.type_name, stamp, source.encode(k))


def _sources(session: Session) -> Iterator[_Source]:
    if session.command is not None:
        yield _joints("/joint_command", session.command)
    if session.states is not None:
        yield _joints("/joint_states", session.states)
    if session.tracker is not None:
        yield _tracker(session.tracker)
    yield from map(_temperature, session.temperature)
    if session.payload is not None:
        yield _payload(session.payload)


def _joints(topic: str, stream: JointStream) -> _Source:
    at, names, rows = stream.stamp_ns, stream.names, stream.position.tolist()
    return _Source(topic, JOINT_STATE, at, lambda k: encode_joint_state(at[k], names, rows[k]))


def _tracker(stream: TrackerStream) -> _Source:
    at, points = stream.stamp_ns, stream.position.tolist()
    if stream.quaternion is None:
        return _Source(
            "/tracker/point",
            POINT_STAMPED,
            at,
            lambda k: encode_point(at[k], TRACKER_FRAME, points[k]),
        )
    turns = stream.quaternion.tolist()
    return _Source(
        "/tracker/pose",
        POSE_STAMPED,
        at,
        lambda k: encode_pose(at[k], TRACKER_FRAME, points[k], turns[k]),
    )


def _temperature(stream: TemperatureStream) -> _Source:
    at, part, celsius = stream.stamp_ns, stream.part, stream.celsius.tolist()
    return _Source(
        "/cell/temperature", TEMPERATURE, at, lambda k: encode_temperature(at[k], part, celsius[k])
    )


def _payload(stream: PayloadStream) -> _Source:
    at, mass, centre = stream.stamp_ns, stream.mass.tolist(), stream.centre.tolist()
    return _Source(
        "/cell/payload",
        INERTIA_STAMPED,
        at,
        lambda k: encode_payload(at[k], PLATFORM_FRAME, mass[k], centre[k]),
        (LATCHED,),
    )
