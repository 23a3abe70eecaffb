from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from delta_calibration.errors import InputError
from delta_calibration.recording import messages
from delta_calibration.recording.messages import (
    INERTIA_STAMPED,
    JOINT_STATE,
    POINT_STAMPED,
    POSE_STAMPED,
    TEMPERATURE,
)
from recording_helpers import NAMES, START_NS, STORE, ros_header, ros_joints

# As published in the packages of ROS 2 Jazzy.
PUBLISHED_HASHES = {
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    POSE_STAMPED: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    TEMPERATURE: "RIHS01_72514a14126ab9f8a9abec974c78e5610a367b59db5da355ff1fb982d5bad4b8",
    INERTIA_STAMPED: "RIHS01_766be45976252babf7f9d8ac4ae7c912a7ceccf71035622529f27518b695aa09",
}

JOINT_STATE_DEFINITION = f"""\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{"=" * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


@pytest.mark.parametrize("type_name", PUBLISHED_HASHES)
def test_hash_is_the_published_one(type_name: str) -> None:
    assert messages.message_type(type_name).hash == PUBLISHED_HASHES[type_name]


def test_definition_has_its_parts_after_eighty_equals_signs() -> None:
    assert messages.message_type(JOINT_STATE).definition == JOINT_STATE_DEFINITION


def test_unknown_type_is_named() -> None:
    with pytest.raises(InputError, match=r"'my_msgs/msg/Arm' is unknown"):
        messages.message_type("my_msgs/msg/Arm")


def _decoded_by_mcap_ros2(type_name: str, data: bytes) -> Any:
    definition = messages.message_type(type_name).definition.encode()
    schema = Schema(id=1, name=type_name, encoding="ros2msg", data=definition)
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    return decode(data)


@pytest.mark.parametrize("names", [NAMES, ("a",), ("long_name_of_a_joint", "b"), ()])
def test_joint_state_is_byte_for_byte_what_rosbags_writes(names: tuple[str, ...]) -> None:
    position = [0.25 * k - 1.0 for k in range(len(names))]
    ours = messages.encode_joint_state(START_NS + 5, names, position)
    assert ours == ros_joints(START_NS + 5, names, position)


@pytest.mark.parametrize("frame", ["", "t", "tracker", "a_frame_of_some_length"])
def test_stamped_messages_are_byte_for_byte_what_rosbags_writes(frame: str) -> None:
    types, header = STORE.types, ros_header(START_NS, frame)
    point = types["geometry_msgs/msg/Point"](1.0, -2.0, 3.5)
    turn = types["geometry_msgs/msg/Quaternion"](0.1, 0.2, 0.3, 0.9)
    pose = types["geometry_msgs/msg/Pose"](point, turn)
    centre = types["geometry_msgs/msg/Vector3"](0.0, 0.01, -0.03)
    inertia = types["geometry_msgs/msg/Inertia"](2.5, centre, *[0.0] * 6)
    pairs = [
        (
            POSE_STAMPED,
            types[POSE_STAMPED](header, pose),
            messages.encode_pose(START_NS, frame, (1.0, -2.0, 3.5), (0.1, 0.2, 0.3, 0.9)),
        ),
        (
            POINT_STAMPED,
            types[POINT_STAMPED](header, point),
            messages.encode_point(START_NS, frame, (1.0, -2.0, 3.5)),
        ),
        (
            TEMPERATURE,
            types[TEMPERATURE](header, 21.5, 0.01),
            messages.encode_temperature(START_NS, frame, 21.5, 0.01),
        ),
        (
            INERTIA_STAMPED,
            types[INERTIA_STAMPED](header, inertia),
            messages.encode_payload(START_NS, frame, 2.5, (0.0, 0.01, -0.03)),
        ),
    ]
    for type_name, message, ours in pairs:
        assert ours == bytes(STORE.serialize_cdr(message, type_name)), type_name


def test_mcap_ros2_decodes_what_was_encoded() -> None:
    joints = _decoded_by_mcap_ros2(
        JOINT_STATE, messages.encode_joint_state(START_NS + 7, NAMES, (0.1, 0.2, 0.3))
    )
    assert (joints.header.stamp.sec, joints.header.stamp.nanosec) == (1_700_000_000, 7)
    assert list(joints.name) == list(NAMES)
    assert list(joints.position) == [0.1, 0.2, 0.3]


def test_equal_content_gives_equal_bytes_from_rows_of_arrays() -> None:
    rows = np.arange(6.0).reshape(2, 3)
    assert messages.encode_joint_state(1, NAMES, rows[1]) == messages.encode_joint_state(
        1, NAMES, [3.0, 4.0, 5.0]
    )


def test_a_position_too_few_is_refused() -> None:
    with pytest.raises(InputError, match="2 joint positions for 3 names"):
        messages.encode_joint_state(0, NAMES, (0.1, 0.2))


@pytest.mark.parametrize("stamp_ns", [2**31 * 10**9, -(2**31 + 1) * 10**9])
def test_a_stamp_that_does_not_fit_is_refused(stamp_ns: int) -> None:
    with pytest.raises(InputError, match="does not fit"):
        messages.encode_temperature(stamp_ns, "arm", 20.0)
