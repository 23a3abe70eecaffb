"""Positions of the numbers in a serialized JointState, whoever serialized it."""

from __future__ import annotations

from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy")
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from delta_calibration.cell import wire_kernel
from delta_calibration.cell.joint_bytes import Bytes, Layout, stamp_of
from delta_calibration.cell.usual import wire_of
from delta_calibration.errors import InputError
from delta_calibration.ros.joint_intake import JointIntake
from ros_helpers import PATIENCE_S  # noqa: F401 - imports now what rclpy would import later

pytestmark = pytest.mark.ros
NAMES = ("joint_1", "joint_2", "joint_3")
Q = np.array([0.25, -1e-300, 3.0])

text = st.text(st.characters(blacklist_characters="\0", blacklist_categories=("Cs",)), max_size=9)
numbers = st.lists(st.floats(allow_nan=False), max_size=6)


def typed(
    names: list[str],
    position: list[float],
    velocity: list[float] = (),
    effort: list[float] = (),
    frame: str = "",
    stamp: tuple[int, int] = (0, 0),
) -> JointState:
    message = JointState(name=names, position=array("d", position))
    message.velocity, message.effort = array("d", velocity), array("d", effort)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    return message


def swapped(message: bytes) -> bytes:
    """The same message with big-endian numbers."""
    layout = Layout.of(message)
    data, at = bytearray(message), 4
    data[1] = 0

    def turn(size: int) -> int:
        nonlocal at
        at += (4 - at) % size
        assert at + size <= len(data)
        value = int.from_bytes(data[at : at + size], "little")
        data[at : at + size] = value.to_bytes(size, "big")
        at += size
        return value

    def words() -> None:
        nonlocal at
        length = turn(4)  # first, because it moves `at`
        at += length

    turn(4), turn(4)
    words()
    for _ in range(turn(4)):
        words()
    for _ in range(3):
        for _ in range(turn(4)):
            turn(8)
    assert layout is not None
    return bytes(data)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(text, max_size=5),
    numbers,
    numbers,
    numbers,
    text,
    st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1)),
)
def test_any_message_of_rclpy_is_read_as_rclpy_reads_it(
    names: list[str],
    position: list[float],
    velocity: list[float],
    effort: list[float],
    frame: str,
    stamp: tuple[int, int],
) -> None:
    message = typed(names, position, velocity, effort, frame, stamp)
    little = serialize_message(message)
    for data in (little, swapped(little)):
        assert deserialize_message(data, JointState) == message
        layout = Layout.of(data)
        assert layout is not None
        assert (list(layout.names), layout.frame_id) == (names, frame)
        assert layout.read(data).tolist() == position
        assert stamp_of(data) == stamp


@settings(max_examples=100, deadline=None)
@given(st.lists(text, max_size=5), text, st.integers(-(2**31), 2**31 - 1))
def test_bytes_made_here_are_the_message_that_was_meant(
    names: list[str], frame: str, sec: int
) -> None:
    position = np.arange(len(names)) / 7.0
    data = Bytes(names, frame).message(position, (sec, 5))
    meant = typed(names, position.tolist(), frame=frame, stamp=(sec, 5))
    assert deserialize_message(data, JointState) == meant


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=120), st.integers(0, 119), st.sampled_from([b"\0\1", b"\0\0", b"\0\7"]))
def test_other_bytes_are_no_layout_and_no_error(noise: bytes, cut: int, kind: bytes) -> None:
    good = Bytes(NAMES, "tool").message(Q, (1, 2))
    for data in (noise, kind + noise, good[:cut], good[:cut] + noise):
        layout = Layout.of(data)
        if layout is not None:
            assert layout.position + 8 * layout.positions <= len(data)
            layout.read(data)
        stamp_of(data)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("velocity", [(), (1.0, 2.0, 3.0)])
def test_compiled_code_reads_the_robots_order_and_knows_another_layout(
    order: tuple[int, ...], big: bool, velocity: tuple[float, ...]
) -> None:
    def made(
        frame: str = "", last: str = "joint_3", stamp: tuple[int, int] = (-3, 7), turn: bool = big
    ) -> bytes:
        names = [*NAMES[:2], last]
        message = typed([names[k] for k in order], Q[list(order)], velocity, (), frame, stamp)
        return (swapped if turn else bytes)(serialize_message(message))

    first = made()
    wire = wire_of(Layout.of(first), first, NAMES)
    q = np.empty(3)
    for data in (first, made(stamp=(5, 999_999_999))):
        q[:] = 0.0
        assert wire_kernel.read(wire, data, q)
        np.testing.assert_array_equal(q, Q)
    others = made(last="joint_4"), made("x"), first[:-1], first + b"\0", made(turn=not big)
    for data in (*others, first[:9]):
        assert not wire_kernel.read(wire, data, q)


def test_bytes_that_only_fill_up_may_be_anything() -> None:
    first = bytearray(serialize_message(typed(["a", "b", "c"], Q)))
    layout = Layout.of(bytes(first))
    filling = [k for k in range(12, len(first)) if layout.changing[k] and not first[k]]
    wire, q = wire_of(layout, bytes(first), ("a", "b", "c")), np.empty(3)
    place = range(layout.position, layout.position + 24)
    for k in filling:
        if k not in place:
            first[k] = 0xAA
    assert wire_kernel.read(wire, bytes(first), q)
    np.testing.assert_array_equal(q, Q)
    np.testing.assert_array_equal(deserialize_message(bytes(first), JointState).position, Q)


def test_what_is_not_finite_is_neither_read_nor_written() -> None:
    data = bytearray(serialize_message(typed(list(NAMES), Q)))
    layout = Layout.of(bytes(data))
    wire = wire_of(layout, bytes(data), NAMES)
    data[layout.position : layout.position + 8] = np.array([np.inf]).tobytes()
    assert not wire_kernel.read(wire, bytes(data), np.empty(3))
    with pytest.raises(InputError, match="inf"):
        Bytes(NAMES).message(np.array([1.0, np.inf, 2.0]), (0, 0))
    with pytest.raises(InputError, match="joint_3"):
        Bytes(NAMES).message(Q[:2], (0, 0))


def test_an_intake_reads_every_layout_and_refuses_what_rclpy_refuses() -> None:
    intake = JointIntake(NAMES)
    for k, turned in enumerate([(0, 1, 2), (0, 1, 2), (2, 1, 0), (2, 1, 0), (1, 0, 2)]):
        names = [NAMES[j] for j in turned]
        message = typed([*names, "gripper"], [*Q[list(turned)], 9.0], frame="tool", stamp=(k, 1))
        read = intake.read(serialize_message(message))
        np.testing.assert_array_equal(read.position, Q)
        assert (read.stamp, read.frame_id) == ((k, 1), "tool")
        assert (read.layout is None) == (k in (1, 3))
    bad = {
        "joint_2 = nan": serialize_message(typed(list(NAMES), [0.0, np.nan, 0.0])),
        "2 positions for 3": serialize_message(typed(list(NAMES), [0.0, 0.0])),
        "expected each": serialize_message(typed(["a", "b", "c"], Q)),
        "bytes that cannot be decoded": serialize_message(typed(list(NAMES), Q))[:40],
    }
    for said, data in bad.items():
        for _ in range(2):
            with pytest.raises(InputError, match=said):
                intake.read(data)
        assert intake.stamp(data) == (0, 0)
    for short in (b"", b"\0\1", b"\0\7\0\0" + bytes(30)):
        assert intake.stamp(short) == (0, 0)
