"""Trajectories of the calibration node: received as bytes, corrected on another thread, in order.

A trajectory of ten thousand points takes a second; streamed commands are processed meanwhile. One
trajectory is corrected at a time. Of those that arrive meanwhile only the newest waits, as a
controller would follow that one alone; the others are counted. After deactivation, none is sent.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory

from delta_calibration.cell.background import Background
from delta_calibration.cell.calibration_session import CalibrationSession
from delta_calibration.cell.trajectory import Points
from delta_calibration.cell.trajectory import Sent as TrajectorySent
from delta_calibration.cell.trajectory_bytes import (
    TrajectoryBytes,
    read_trajectory,
    write_trajectory,
)
from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.ros.controllers import points_in_order, points_of, trajectory
from delta_calibration.ros.conversions import JointReader, stamp_to_ns

POLL_S = 0.002  # [s] until the end of the work is noticed
REPLACED = "trajectory replaced by a newer one"


@dataclass(frozen=True)
class _Work:
    """One trajectory that is being corrected."""

    desk: CalibrationSession
    came_s: float  # steady time
    background: Background[tuple[TrajectorySent, Callable[[Points], bytes], bool]]


class Trajectories:
    """Corrects trajectories beside the command path.

    Args:
        node: node whose clock and executor are used.
        mark: header.frame_id of a compensated trajectory.
        send: function that sends a serialized trajectory to the controller.
        tell: callback that gets the session and a problem with a trajectory that was sent.
        refuse: callback that gets the session and the reason why one was not sent.
    """

    def __init__(
        self,
        node: Node,
        mark: str,
        send: Callable[[bytes], None],
        tell: Callable[[CalibrationSession, str], None],
        refuse: Callable[[CalibrationSession, str], None],
    ) -> None:
        self._node, self._mark, self._send = node, mark, send
        self._tell, self._refuse = tell, refuse
        self._work: _Work | None = None
        self._waiting: tuple[CalibrationSession, bytes, float, int] | None = None
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._poll = node.create_timer(POLL_S, self._look, clock=steady)
        self._poll.cancel()

    def take(self, desk: CalibrationSession, data: bytes) -> None:
        """Start to correct a trajectory, or let it wait until the present one is done."""
        if self._waiting is not None:
            desk.path.counts[REPLACED] += 1
        self._waiting = desk, data, time.monotonic(), self._node.get_clock().now().nanoseconds
        if self._work is None:
            self._begin()

    def drop(self) -> bool:
        """Drop all trajectories; return whether there were any."""
        busy = self._work is not None or self._waiting is not None
        self._work = self._waiting = None
        self._poll.cancel()
        return busy

    def _begin(self) -> None:
        assert self._waiting is not None
        (desk, data, came_s, clock_ns), self._waiting = self._waiting, None
        joints = desk.robot.joints
        reader = JointReader(joints.names, joints.passed_through)
        read = _Reading(data, reader, came_s, clock_ns, self._mark)
        begun = desk.begin_all(read.points, came_s)

        def work() -> tuple[TrajectorySent, Callable[[Points], bytes], bool]:
            return begun(), read.written, read.at_once

        self._work = _Work(desk, came_s, Background(work))
        self._poll.reset()

    def _look(self) -> None:
        """Send a finished trajectory, and start with the waiting one."""
        if self._work is None or not self._work.background.done:
            return
        done, self._work = self._work, None
        try:
            self._finish(done)
        except CalibrationError as error:
            self._refuse(done.desk, str(error))
        if self._waiting is not None:
            self._begin()
        else:
            self._poll.cancel()

    def _finish(self, done: _Work) -> None:
        sent, written, at_once = done.background.result()
        late_s = time.monotonic() - done.came_s if at_once else 0.0
        points = done.desk.trajectories.end(sent, late_s)
        self._send(written(points))
        if done.desk.path.trouble is not None:
            self._tell(done.desk, done.desk.path.trouble)


class _Reading:
    """Received message that is parsed on the worker thread: by arrays, or else by rclpy."""

    def __init__(
        self, data: bytes, reader: JointReader, came_s: float, clock_ns: int, mark: str
    ) -> None:
        self._data, self._reader, self._mark = data, reader, mark
        self._names = reader.names + reader.passed_through
        self._came_s, self._clock_ns = came_s, clock_ns
        self._plain: TrajectoryBytes | None = None
        self._message: JointTrajectory | None = None
        self.at_once = False  # whether it starts on arrival (stamp zero)

    def points(self) -> tuple[Points, bool]:
        """Points in the robot's order, and whether another node has compensated them.

        Raises:
            InputError: see `points_of`.
        """
        reader = self._reader
        self._plain = read_trajectory(self._data)
        if self._plain is None:
            return self._as_message(reader)
        plain = self._plain
        seconds, nanoseconds = plain.stamp
        self.at_once = plain.stamp == (0, 0)
        order = reader.order(plain.names)
        time_s = plain.time
        if time_s[0] < 0.0 or (np.diff(time_s) <= 0.0).any():
            raise InputError(
                "JointTrajectory.points: time_from_start has to rise from point to point"
            )
        for field, values in (("positions", plain.joint), ("velocities", plain.velocity)):
            if values is not None and not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
                where = f"JointTrajectory.points[{row}].{field}"
                raise InputError(f"{where}: {values[row].tolist()}; finite values are needed")
        wait_s = (seconds * 10**9 + nanoseconds - self._clock_ns) * 1e-9
        start_s = self._came_s + (0.0 if self.at_once else wait_s)
        velocity = None if plain.velocity is None else plain.velocity[:, order]
        joint, m = plain.joint[:, order], len(reader.names)
        points = points_in_order(start_s + time_s, joint, velocity, m)
        return points, plain.frame == self._mark

    def _as_message(self, reader: JointReader) -> tuple[Points, bool]:
        message = deserialize_message(self._data, JointTrajectory)
        self._message = message
        stamp_ns = stamp_to_ns(message.header.stamp)
        self.at_once = stamp_ns == 0
        wait_s = (stamp_ns - self._clock_ns) * 1e-9
        return points_of(message, reader, self._came_s, wait_s), (
            message.header.frame_id == self._mark
        )

    def written(self, points: Points) -> bytes:
        """Serialize the message with new positions and velocities, in the robot's order.

        Pass-through axes follow behind the joints if the message contains them.
        """
        if self._plain is None:
            out: Any = trajectory(self._message, points, self._names, self._mark)
            return bytes(serialize_message(out))
        plain = self._plain
        frame = self._mark if points.compensated else ""
        joint, velocity = points.whole
        return write_trajectory(
            plain.stamp,
            frame,
            self._names[: joint.shape[1]],
            joint,
            velocity,
            plain.seconds,
            plain.nanoseconds,
        )
