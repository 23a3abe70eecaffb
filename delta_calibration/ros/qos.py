"""Topics of the interface: name, type and quality of service (QoS) on each side.

Subscriptions to measured streams are best effort, which matches both kinds of publisher;
publishers of this package are reliable, which matches both kinds of subscription. Depth 10 loses
messages at 1 kHz, so streams have 100.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import InertiaStamped, PointStamped, PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, Temperature


def _profile(depth: int, *, best_effort: bool = False, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


COMMAND = _profile(100)
MEASURED = _profile(100, best_effort=True)
STREAM_OUT = _profile(100)
CONTROLLER = _profile(1)
PAYLOAD = _profile(1, latched=True)
DIAGNOSTICS = _profile(10)
STATUS = _profile(1, latched=True)
CLOCK = _profile(10)


@dataclass(frozen=True)
class Topic:
    """One topic of the interface.

    Attributes:
        name: relative name, so that namespaces and remaps act on it.
        type_name: name of the type, such as `sensor_msgs/msg/JointState`.
        message: class of its messages.
        reader: profile to subscribe with.
        writer: profile to publish with.
    """

    name: str
    type_name: str
    message: Any
    reader: QoSProfile
    writer: QoSProfile

    @property
    def latched(self) -> bool:
        """Whether a late subscriber gets the last message."""
        return bool(self.reader.durability == DurabilityPolicy.TRANSIENT_LOCAL)


JOINT_STATE = "sensor_msgs/msg/JointState"
POSE = "geometry_msgs/msg/PoseStamped"
POINT = "geometry_msgs/msg/PointStamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"
INERTIA = "geometry_msgs/msg/InertiaStamped"

INPUTS: tuple[Topic, ...] = (
    Topic("joint_command", JOINT_STATE, JointState, COMMAND, STREAM_OUT),
    Topic("joint_states", JOINT_STATE, JointState, MEASURED, STREAM_OUT),
    Topic("tracker/pose", POSE, PoseStamped, MEASURED, STREAM_OUT),
    Topic("tracker/point", POINT, PointStamped, MEASURED, STREAM_OUT),
    Topic("cell/temperature", TEMPERATURE, Temperature, MEASURED, STREAM_OUT),
    Topic("cell/payload", INERTIA, InertiaStamped, PAYLOAD, PAYLOAD),
)
BY_NAME = {topic.name: topic for topic in INPUTS}


def deeper(profile: QoSProfile, depth: int) -> QoSProfile:
    """Copy a profile with another queue depth, which the other side does not see."""
    return QoSProfile(depth=depth, reliability=profile.reliability, durability=profile.durability)
