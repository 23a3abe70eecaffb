"""Messages on a session's topics: definition, hash, and CDR encoding.

A message on the wire is CDR: two bytes that name the encoding (0x0001, little endian), two of
options, then the fields in order, each aligned to its own size counted from byte 4:

    string      uint32 length with the closing zero, the characters, a zero
    float64[]   uint32 length, padding to 8 if there is any element, the numbers

All five message types start with a `std_msgs/Header` (stamp, frame) and carry one block of float64
that is used. Padding is always zero here, so that equal content gives equal bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from delta_calibration.errors import InputError

JOINT_STATE = "sensor_msgs/msg/JointState"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
POINT_STAMPED = "geometry_msgs/msg/PointStamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"
INERTIA_STAMPED = "geometry_msgs/msg/InertiaStamped"

ENCAPSULATION = b"\x00\x01\x00\x00"
_STAMP = struct.Struct("<iI")


@dataclass(frozen=True)
class MessageType:
    """Description of a message type that a recording contains, so that others can decode it."""

    name: str
    definition: str  # ros2msg: its text, then each type it uses after 80 "=" and "MSG: pkg/Name"
    hash: str  # RIHS01_ and the sha256 of the type's description


@lru_cache(maxsize=128)
def message_type(name: str) -> MessageType:
    """Definition and hash of a ROS 2 Jazzy message type.

    Args:
        name: Full name, `sensor_msgs/msg/JointState`.

    Raises:
        InputError: The type is not one of ROS 2's common ones.
    """
    # Imported late: loading the store takes 0.2 s, and reading a session does not need it.
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    if name not in store.fielddefs:
        raise InputError(
            f"message type {name!r} is unknown: a type of ROS 2's common interfaces is needed,"
            " written package/msg/Name"
        )
    definition, _ = store.generate_msgdef(name, ros_version=2)
    return MessageType(name, definition, store.hash_rihs01(name))


def encode_joint_state(stamp_ns: int, names: Sequence[str], position: Sequence[float]) -> bytes:
    """CDR of a JointState: `position` [rad] of the joints `names`, no velocity, no effort."""
    if len(names) != len(position):
        raise InputError(f"{len(position)} joint positions for {len(names)} names")
    values = struct.pack(f"<{len(position)}d", *position)
    return ENCAPSULATION + _stamp(stamp_ns) + _joint_head(tuple(names)) + values + bytes(8)


def encode_pose(
    stamp_ns: int, frame: str, position: Sequence[float], quaternion: Sequence[float]
) -> bytes:
    """CDR of a PoseStamped: `position` (3,) [m] and `quaternion` (4,) x y z w."""
    return _stamped(stamp_ns, frame, struct.pack("<7d", *position, *quaternion))


def encode_point(stamp_ns: int, frame: str, position: Sequence[float]) -> bytes:
    """CDR of a PointStamped: `position` (3,) [m]."""
    return _stamped(stamp_ns, frame, struct.pack("<3d", *position))


def encode_temperature(stamp_ns: int, part: str, celsius: float, variance: float = 0.0) -> bytes:
    """CDR of a Temperature [deg C] of `part`; variance zero means unknown, as the type says."""
    return _stamped(stamp_ns, part, struct.pack("<2d", celsius, variance))


def encode_payload(stamp_ns: int, frame: str, mass: float, centre: Sequence[float]) -> bytes:
    """CDR of an InertiaStamped: `mass` [kg] and `centre` (3,) [m]; the moments stay zero."""
    return _stamped(stamp_ns, frame, struct.pack("<4d", mass, *centre) + bytes(48))


def _stamp(stamp_ns: int) -> bytes:
    seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
    try:
        return _STAMP.pack(seconds, nanoseconds)
    except struct.error:
        raise InputError(f"stamp {stamp_ns} ns does not fit a message (int32 seconds)") from None


def _stamped(stamp_ns: int, frame: str, values: bytes) -> bytes:
    return ENCAPSULATION + _stamp(stamp_ns) + _frame_head(frame) + values


@lru_cache(maxsize=64)
def _frame_head(frame: str) -> bytes:
    """Bytes between the stamp and the block of float64: the frame's name and padding."""
    return _aligned(_with_string(bytes(8), frame), 8)[8:]


@lru_cache(maxsize=64)
def _joint_head(names: tuple[str, ...]) -> bytes:
    """Bytes between the stamp of a JointState and its positions: an empty frame, the names."""
    count = len(names).to_bytes(4, "little")
    body = _aligned(_with_string(bytes(8), ""), 4) + count
    for name in names:
        body = _with_string(body, name)
    body = _aligned(body, 4) + count
    return (_aligned(body, 8) if names else body)[8:]


def _with_string(body: bytes, text: str) -> bytes:
    raw = text.encode() + b"\0"
    return _aligned(body, 4) + len(raw).to_bytes(4, "little") + raw


def _aligned(body: bytes, size: int) -> bytes:
    return body + bytes(-len(body) % size)
