"""Conversion of messages to arrays and back, and refused messages."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")
from geometry_msgs.msg import InertiaStamped, PointStamped
from sensor_msgs.msg import JointState, Temperature

from delta_calibration.errors import InputError
from delta_calibration.ros.conversions import (
    JointReader,
    joint_state,
    ns_to_stamp,
    payload,
    pose_stamped,
    stamp_to_ns,
    temperature,
    tracker_point,
    tracker_pose,
)
from delta_calibration.ros.diagnostics import status

pytestmark = pytest.mark.ros
NAMES = ("joint_1", "joint_2", "joint_3")
STAMP_NS = 1_700_000_000_000_000_007
STAMP = ns_to_stamp(STAMP_NS)


def message(names: tuple[str, ...], position: list[float]) -> JointState:
    return JointState(name=list(names), position=position)


def test_a_stamp_keeps_every_nanosecond() -> None:
    assert stamp_to_ns(STAMP) == STAMP_NS
    assert (STAMP.sec, STAMP.nanosec) == (1_700_000_000, 7)


def test_joints_come_out_in_the_robots_order_whatever_order_they_arrive_in() -> None:
    reader = JointReader(NAMES)
    shuffled = message(("gripper", "joint_3", "joint_1", "joint_2"), [9.0, 0.3, 0.1, 0.2])
    np.testing.assert_array_equal(reader.positions(shuffled), [0.1, 0.2, 0.3])
    other = message(("joint_2", "joint_3", "joint_1"), [0.2, 0.3, 0.1])
    np.testing.assert_array_equal(reader.positions(other), [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(reader.positions(shuffled), [0.1, 0.2, 0.3])


def test_joint_states_survive_the_way_there_and_back() -> None:
    position = np.array([0.1, -0.2, 0.3])
    sent = joint_state(NAMES, position, STAMP)
    np.testing.assert_array_equal(JointReader(NAMES).positions(sent), position)
    assert stamp_to_ns(sent.header.stamp) == STAMP_NS


@pytest.mark.parametrize(
    ("names", "position", "said"),
    [
        (("joint_1", "joint_2", "elbow"), [0.0, 0.0, 0.0], r"\['joint_1', .*found .*'elbow'\]"),
        (("joint_1", "joint_2"), [0.0, 0.0], "expected each of the joints"),
        ((), [0.0, 0.0, 0.0], r"found \[\]"),
        (("joint_1", "joint_2", "joint_3", "joint_3"), [0.0] * 4, "once"),
        (NAMES, [0.0, 0.0], "2 positions for 3 names"),
        (NAMES, [], "0 positions for 3 names"),
        (NAMES, [0.0, float("nan"), 0.0], "joint_2 = nan"),
        (NAMES, [0.0, 0.0, float("inf")], "joint_3 = inf"),
    ],
)
def test_wrong_joint_states_are_refused(
    names: tuple[str, ...], position: list[float], said: str
) -> None:
    reader = JointReader(NAMES)
    with pytest.raises(InputError, match=said):
        reader.positions(message(names, position))
    good = message(NAMES, [1.0, 2.0, 3.0])  # the refused message does not affect the next one
    np.testing.assert_array_equal(reader.positions(good), [1.0, 2.0, 3.0])


def test_only_complete_and_finite_joint_states_are_sent() -> None:
    with pytest.raises(InputError, match="positions for the names"):
        joint_state(NAMES, np.zeros(2), STAMP)
    with pytest.raises(InputError, match="joint_1 = nan"):
        joint_state(NAMES, np.array([np.nan, 0.0, 0.0]), STAMP)


def test_a_pose_survives_the_way_there_and_back() -> None:
    position, quaternion = np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.6, 0.0, 0.8])
    sent = pose_stamped(position, quaternion, STAMP)
    reading = tracker_pose(sent)
    assert sent.header.frame_id == "tracker"
    assert reading.stamp_ns == STAMP_NS
    np.testing.assert_array_equal(reading.position, position)
    np.testing.assert_allclose(reading.quaternion, quaternion, rtol=1e-15)


def test_a_quaternion_of_a_wrong_length_is_refused_except_where_only_the_position_counts() -> None:
    sent = pose_stamped(np.zeros(3), np.zeros(4), STAMP)
    with pytest.raises(InputError, match="length 0, must be 1"):
        tracker_pose(sent)
    assert tracker_pose(sent, position_only=True).quaternion is None


def test_a_point_that_is_not_finite_is_refused() -> None:
    point = PointStamped()
    point.point.x, point.point.y, point.point.z = 1.0, 2.0, 3.0
    np.testing.assert_array_equal(tracker_point(point).position, [1.0, 2.0, 3.0])
    point.point.y = float("nan")
    with pytest.raises(InputError, match="y = nan"):
        tracker_point(point)


@pytest.mark.parametrize("count", [3, 100_000])
def test_what_is_said_of_a_message_is_a_line_of_bounded_length(count: int) -> None:
    long = f"joint\n{'x' * 1000}"
    wrong = message((long,) * count, [0.0] * count)
    fewer = message((*NAMES, *(long,) * count), [0.0])
    hot = Temperature(temperature=float("nan"))
    hot.header.frame_id = long
    for take, bad in (
        (JointReader(NAMES).positions, wrong),
        (JointReader(NAMES).positions, fewer),
        (temperature, hot),
    ):
        with pytest.raises(InputError, match=r"'joint\\nx+\.\.\.'") as caught:
            take(bad)
        assert len(str(caught.value)) < 1000
        assert "\n" not in str(caught.value)


def test_a_temperature_needs_a_part() -> None:
    sent = Temperature(temperature=21.5)
    with pytest.raises(InputError, match="frame_id"):
        temperature(sent)
    sent.header.frame_id, sent.header.stamp = "arm", STAMP
    assert temperature(sent) == ("arm", STAMP_NS, 21.5)
    sent.temperature = float("nan")
    with pytest.raises(InputError, match="'arm' = nan"):
        temperature(sent)


def test_a_part_has_a_name_and_no_story() -> None:
    sent = Temperature(temperature=21.5)
    sent.header.frame_id = "x" * 3000
    with pytest.raises(InputError, match="3000 characters") as caught:
        temperature(sent)
    assert len(str(caught.value)) < 300


def test_diagnostics_are_bounded_whatever_is_told() -> None:
    told = status(b"\0", "node", "y" * 3000, {"k" * 3000: "v" * 3000})
    (pair,) = told.values
    assert all(len(text) < 1100 for text in (told.message, pair.key, pair.value))


def test_a_payload_has_a_mass_that_is_not_negative() -> None:
    sent = InertiaStamped()
    sent.inertia.m, sent.inertia.com.z = 2.0, -0.05
    _, mass, centre = payload(sent)
    assert mass == 2.0
    np.testing.assert_array_equal(centre, [0.0, 0.0, -0.05])
    sent.inertia.m = -1.0
    with pytest.raises(InputError, match="negative"):
        payload(sent)
