"""Sessions and files for the tests of `recording`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from delta_calibration.data.streams import (
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
)
from delta_calibration.recording.messages import (
    JOINT_STATE,
    POINT_STAMPED,
    POSE_STAMPED,
    encode_joint_state,
    encode_point,
    encode_pose,
    message_type,
)

SHARED = Path(__file__).parents[1].parent / "shared"
NONE = SHARED / "sessions" / "none"
START_NS = 1_700_000_000_000_000_000
NAMES = ("joint_1", "joint_2", "joint_3")
STORE = get_typestore(Stores.ROS2_JAZZY)

Sent = tuple[str, str, int, bytes]  # topic, type, time of arrival, CDR bytes
MS = 1_000_000
COMMAND, STATES, POSE, POINT = "/joint_command", "/joint_states", "/tracker/pose", "/tracker/point"
NO_TURN = (0.0, 0.0, 0.0, 1.0)


def make_session(rng: np.random.Generator, n: int = 200, *, point: bool = False) -> Session:
    """A session with all streams, of random numbers."""
    stamp = START_NS + np.arange(n) * 1_000_001
    turn = rng.normal(size=(n, 4))
    return Session(
        source="made",
        command=JointStream(stamp, NAMES, rng.normal(size=(n, 3))),
        states=JointStream(stamp + 7, NAMES, rng.normal(size=(n, 3))),
        tracker=TrackerStream(
            stamp + 11,
            rng.normal(size=(n, 3)),
            None if point else turn / np.linalg.norm(turn, axis=1, keepdims=True),
        ),
        temperature=(
            TemperatureStream("arm", stamp[::10], rng.normal(20.0, 1.0, size=n)[::10]),
            TemperatureStream("forearm", stamp[::10] + 1, rng.normal(20.0, 1.0, size=n)[::10]),
        ),
        payload=PayloadStream(
            stamp[::50], rng.uniform(0, 2, n)[::50], rng.normal(size=(n, 3))[::50]
        ),
        metadata={"robot": "srbd", "seed": "3"},
    )


def assert_same_streams(read: Session, meant: Session) -> None:
    """Assert that all streams of both exist and are equal to the last bit."""
    for name in ("command", "states"):
        a, b = getattr(read, name), getattr(meant, name)
        assert a.names == b.names
        np.testing.assert_array_equal(a.stamp_ns, b.stamp_ns)
        np.testing.assert_array_equal(a.position, b.position)
    assert read.tracker is not None
    assert meant.tracker is not None
    np.testing.assert_array_equal(read.tracker.stamp_ns, meant.tracker.stamp_ns)
    np.testing.assert_array_equal(read.tracker.position, meant.tracker.position)
    assert (read.tracker.quaternion is None) == (meant.tracker.quaternion is None)
    if meant.tracker.quaternion is not None:
        np.testing.assert_array_equal(read.tracker.quaternion, meant.tracker.quaternion)
    assert [t.part for t in read.temperature] == [t.part for t in meant.temperature]
    for warm, other in zip(read.temperature, meant.temperature, strict=True):
        np.testing.assert_array_equal(warm.stamp_ns, other.stamp_ns)
        np.testing.assert_array_equal(warm.celsius, other.celsius)
    assert (read.payload is None) == (meant.payload is None)
    if read.payload is not None and meant.payload is not None:
        np.testing.assert_array_equal(read.payload.stamp_ns, meant.payload.stamp_ns)
        np.testing.assert_array_equal(read.payload.mass, meant.payload.mass)
        np.testing.assert_array_equal(read.payload.centre, meant.payload.centre)


def ros_header(stamp_ns: int, frame: str = "") -> Any:
    """A `std_msgs/Header` of rosbags."""
    types = STORE.types
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    return types["std_msgs/msg/Header"](time, frame)


def ros_joints(
    stamp_ns: int,
    names: Iterable[str],
    position: Iterable[float],
    velocity: Iterable[float] = (),
    *,
    little_endian: bool = True,
    frame: str = "",
) -> bytes:
    """A JointState encoded by rosbags, which is independent of this package."""
    message = STORE.types[JOINT_STATE](
        ros_header(stamp_ns, frame),
        list(names),
        np.array(list(position), np.float64),
        np.array(list(velocity), np.float64),
        np.empty(0),
    )
    return bytes(STORE.serialize_cdr(message, JOINT_STATE, little_endian=little_endian))


def foreign_mcap(
    path: Path,
    sent: Iterable[Sent],
    *,
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 4096,
    chunked: bool = True,
    encoding: str = "cdr",
) -> Path:
    """An MCAP file written directly by its library, as another recorder would."""
    with path.open("wb") as stream:
        writer = Writer(
            stream, chunk_size=chunk_size, compression=compression, use_chunking=chunked
        )
        writer.start(profile="ros2", library="somebody else")
        channels: dict[tuple[str, str], int] = {}
        for topic, type_name, log_time, data in sent:
            if (topic, type_name) not in channels:
                text = message_type(type_name).definition.encode()
                schema = writer.register_schema(type_name, "ros2msg", text)
                channels[topic, type_name] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic, type_name], log_time, data, log_time)
        writer.finish()
    return path


def joints(k: int, topic: str = STATES, names: Iterable[str] = NAMES) -> Sent:
    stamp = START_NS + k * MS
    return topic, JOINT_STATE, stamp, encode_joint_state(stamp, tuple(names), (k, 10 + k, 20 + k))


def pose(k: int, topic: str = POSE) -> Sent:
    stamp = START_NS + k * MS
    return topic, POSE_STAMPED, stamp, encode_pose(stamp, "tracker", (k, 1.0, 2.0), NO_TURN)


def point(k: int, topic: str = POINT) -> Sent:
    stamp = START_NS + k * MS
    return topic, POINT_STAMPED, stamp, encode_point(stamp, "tracker", (-k, 1.0, 2.0))


def both(n: int, make: Callable[[int], Sent] = joints) -> list[Sent]:
    return [message for k in range(n) for message in (make(k), pose(k))]
