"""Trajectories as bytes, compared with the serialization of the middleware."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Duration
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from delta_calibration.cell.trajectory_bytes import read_trajectory, write_trajectory

RNG = np.random.default_rng(0)


def message(names, frame="", velocities=True, n=5):
    out = JointTrajectory(joint_names=list(names))
    out.header.frame_id = frame
    out.header.stamp.sec, out.header.stamp.nanosec = 7, 11
    for row in range(n):
        q, v = RNG.standard_normal((2, len(names)))
        point = JointTrajectoryPoint(positions=q.tolist())
        point.velocities = v.tolist() if velocities else []
        point.time_from_start = Duration(sec=row, nanosec=3 * row + 1)
        out.points.append(point)
    return out


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    st.lists(st.text("abcé_1", min_size=1, max_size=9), min_size=1, max_size=8, unique=True),
    st.text("abc", max_size=9),
    st.booleans(),
)
def test_read_and_written_as_the_middleware_does(names, frame, velocities):
    sent = message(names, frame, velocities)
    read = read_trajectory(serialize_message(sent))
    assert read is not None
    assert (read.names, read.frame, read.stamp) == (tuple(names), frame, (7, 11))
    np.testing.assert_array_equal(read.joint, [p.positions for p in sent.points])
    assert (read.velocity is not None) == velocities
    seconds = [p.time_from_start.sec + p.time_from_start.nanosec * 1e-9 for p in sent.points]
    np.testing.assert_allclose(read.time, seconds, rtol=1e-15)
    written = write_trajectory(
        read.stamp,
        read.frame,
        read.names,
        read.joint,
        read.velocity,
        read.seconds,
        read.nanoseconds,
    )
    assert deserialize_message(written, JointTrajectory) == sent


def test_what_is_laid_out_otherwise_is_left_to_the_middleware():
    uneven = message(("a", "b"))
    uneven.points[2].velocities = []
    pushed = message(("a", "b"))
    pushed.points[0].effort = [1.0, 2.0]
    short = message(("a", "b"))
    short.points[1].positions = [1.0]
    for odd in (uneven, pushed, short, JointTrajectory(joint_names=["a"])):
        assert read_trajectory(serialize_message(odd)) is None
    plain = serialize_message(message(("a", "b")))
    assert read_trajectory(b"\x00\x00" + plain[2:]) is None  # big-endian
    for cut in (0, 3, 20, len(plain) // 2):
        assert read_trajectory(plain[:cut]) is None
