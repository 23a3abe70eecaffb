"""Hostile messages end no node, and a valid command is still answered afterwards."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy")
from geometry_msgs.msg import InertiaStamped, PointStamped, PoseStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState, Temperature

from delta_calibration.robot import load_robot
from delta_calibration.ros.calibration_node import CalibrationNode
from delta_calibration.ros.qos import INPUTS, STREAM_OUT
from ros_helpers import Bench

pytestmark = pytest.mark.ros

ROBOT = load_robot("srbd")
NAMES = list(ROBOT.joints.names)
SOUND = [0.0] * len(NAMES)
NUMBERS = st.one_of(
    st.floats(),
    st.sampled_from([float("nan"), float("inf"), 1e308, -1e308, 5e-324, 0.0, 1e-3]),
)
STAMPS = st.tuples(
    st.sampled_from([0, 1, -1, 2**31 - 1, -(2**31), 1_700_000_000]),
    st.sampled_from([0, 999_999_999, 10**9, 2**32 - 1]),
)
NAME = st.one_of(st.sampled_from([*NAMES, "", "x" * 5000]), st.text(max_size=5))
FRAME = st.sampled_from(["", "tracker", "compensated", "arm", "\n\x1b[31m", "y" * 3000])


def hostile(kind: type, stamp: Any, frame: str, numbers: list[float], names: list[str]) -> Any:
    """A message that is valid for its type, but that no correct sender would send."""
    message = kind()
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    message.header.frame_id = frame
    a, b, c, d = numbers[:4]
    if kind is JointState:
        message.name, message.position = names, array("d", numbers[4:])
    elif kind is Temperature:
        message.temperature, message.variance = a, b
    elif kind is InertiaStamped:
        message.inertia.m, message.inertia.com.x, message.inertia.com.z = a, b, c
    elif kind is PointStamped:
        message.point.x, message.point.y, message.point.z = a, b, c
    else:
        assert kind is PoseStamped
        at, turn = message.pose.position, message.pose.orientation
        at.x, at.y, turn.x, turn.w = a, b, c, d
    return message


MESSAGES = st.builds(
    hostile,
    st.sampled_from([topic.message for topic in INPUTS]),
    STAMPS,
    FRAME,
    st.lists(NUMBERS, min_size=4, max_size=9),
    st.one_of(st.just(NAMES), st.lists(NAME, max_size=6)),
)


@st.composite
def wire(draw: st.DrawFn) -> tuple[int, bytes | Any]:
    """Number of a topic and what is sent on it: a message, or invalid bytes."""
    message = draw(MESSAGES)
    fits = [k for k, topic in enumerate(INPUTS) if topic.message is type(message)]
    where = draw(st.sampled_from(fits))
    if draw(st.booleans()):
        return where, message
    data = bytes(serialize_message(message))
    cut = draw(st.integers(0, len(data)))
    tail = draw(st.sampled_from([b"", b"\xff" * 8, b"\xff\xff\xff\x7f", b"\x00" * 400]))
    return draw(st.integers(0, len(INPUTS) - 1)), data[:cut] + tail


@pytest.fixture(name="cell", scope="module")
def cell_fixture() -> Iterator[tuple[Bench, CalibrationNode, list[Any], list[Any]]]:
    """A running node, publishers for all its topics, and the messages that it sends."""
    bench = Bench()
    try:
        node = bench.add(CalibrationNode(context=bench.context))
        node.trigger_configure()
        node.trigger_activate()
        peer = bench.node("peer")
        senders = [peer.create_publisher(t.message, t.name, t.writer) for t in INPUTS]
        came: list[Any] = []
        peer.create_subscription(JointState, "joint_command_compensated", came.append, STREAM_OUT)
        assert bench.until(lambda: all(s.get_subscription_count() for s in senders))
        assert bench.until(lambda: node._out.get_subscription_count())
        yield bench, node, senders, came
    finally:
        bench.take_down()


@settings(
    max_examples=60,
    derandomize=True,
    phases=[Phase.generate],  # failures are reported without shrinking
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)
@given(st.lists(wire(), min_size=1, max_size=6))
def test_no_message_ends_a_node(cell: Any, sent: list[tuple[int, Any]]) -> None:
    """An exception would leave the spin here, and would end the process of a node."""
    bench, node, senders, came = cell
    for where, what in sent:
        senders[where].publish(what)
    bench.spin_for(0.03)
    assert node.state == "active"
    assert np.isfinite([message.position for message in came]).all()
    came.clear()


def test_the_commands_of_the_controller_come_through_after_all_that(cell: Any) -> None:
    """The middleware may block a sender after an invalid message, but no other sender."""
    bench, node, _senders, came = cell
    controller = bench.node("controller")
    senders = [controller.create_publisher(t.message, t.name, t.writer) for t in INPUTS[:2]]
    assert bench.until(lambda: all(s.get_subscription_count() for s in senders))
    node.trigger_deactivate()
    node.trigger_activate()
    came.clear()

    def through() -> bool:
        senders[1].publish(stamped(bench))
        senders[0].publish(stamped(bench))
        bench.spin_for(0.05)
        return any(list(message.position) == SOUND for message in came)

    assert bench.until(through, 5.0)


def stamped(bench: Bench) -> JointState:
    message = JointState(name=NAMES, position=SOUND)
    message.header.stamp = bench.nodes[-1].get_clock().now().to_msg()
    return message
