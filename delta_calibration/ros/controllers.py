"""Messages to the controllers of ros2_control, and conversion of received trajectories."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from numpy.typing import NDArray
from rclpy.lifecycle import LifecycleNode
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from delta_calibration.cell.trajectory import Points
from delta_calibration.errors import InputError
from delta_calibration.ros.conversions import NANOSECONDS, JointReader
from delta_calibration.ros.qos import CONTROLLER

Array = NDArray[np.float64]


class Controllers:
    """Publishers to controllers, in addition to `joint_command_compensated`; none by default.

    Args:
        node: node that publishes.
        names: (m,) names of the robot's joints.
        passed_through: (k,) names of pass-through axes that commands may contain.
        commands: name of a forward_command_controller; empty for none.
        order: joints in the order of that controller, with or without the pass-through axes; empty
            for the robot's order, with them.
        trajectories: name of a joint_trajectory_controller; empty for none.

    Raises:
        InputError: the order is no permutation of the robot's joints.
    """

    def __init__(
        self,
        node: LifecycleNode,
        names: Sequence[str],
        passed_through: Sequence[str],
        commands: str,
        order: Sequence[str],
        trajectories: str,
    ) -> None:
        every = [*names, *passed_through]
        if order and sorted(order) not in (sorted(names), sorted(every)):
            besides = f", with {list(passed_through)} or without" if passed_through else ""
            raise InputError(
                f"parameter command_joints: {list(order)}; expected {list(names)} in any "
                f"order{besides}"
            )
        self._node, self._names, self._given = node, every, commands
        self._order = [every.index(name) for name in order or every]
        self._commands = self._trajectories = None
        if commands:
            topic = f"{commands}/commands"
            self._commands = node.create_lifecycle_publisher(Float64MultiArray, topic, CONTROLLER)
        if trajectories:
            topic = f"{trajectories}/joint_trajectory"
            self._trajectories = node.create_lifecycle_publisher(
                JointTrajectory, topic, CONTROLLER
            )

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in filter(None, (self._commands, self._trajectories)):
            self._node.destroy_lifecycle_publisher(publisher)
        self._commands = self._trajectories = None

    def send(self, joint: Array, mark: str, as_trajectory: bool = True) -> str:
        """Send a command to each controller, to the trajectory controller as a one-point one.

        Args:
            joint: (m,) [rad], or (m + k,) with the pass-through axes.
            mark: header.frame_id that marks a compensated command; empty if it is not.
            as_trajectory: whether the trajectory controller gets it.

        Returns:
            Why it could not be sent to a controller; else empty.
        """
        why = ""
        if self._commands is not None and max(self._order) >= len(joint):
            lacking = ", ".join(self._names[len(joint) :])
            why = f"{self._given}: a command without {lacking} is not sent; it needs all joints"
        elif self._commands is not None:
            self._commands.publish(Float64MultiArray(data=array("d", joint[self._order])))
        if as_trajectory and self._trajectories is not None:
            # No stamp means: from now on. With a stamp, the point would already lie in the past.
            message = JointTrajectory(joint_names=self._names[: len(joint)])
            message.header.frame_id = mark
            message.points = [JointTrajectoryPoint(positions=array("d", joint))]
            self._trajectories.publish(message)
        return why

    def send_all(self, data: bytes) -> None:
        """Send a serialized trajectory to the trajectory controller."""
        if self._trajectories is not None:
            self._trajectories.publish(data)


def points_of(
    message: JointTrajectory, reader: JointReader, now_s: float, wait_s: float
) -> Points:
    """Convert a trajectory message to points in the robot's order, on the steady clock.

    Args:
        message: message as received; a stamp of zero means from now on.
        reader: reader of the robot's joints.
        now_s: steady time [s].
        wait_s: time from now to the message's stamp [s].

    Raises:
        InputError: no points, names or sizes that do not fit, times that do not rise, velocities
            at some points only, or a value that is not finite.
    """
    order = reader.order(message.joint_names)
    if not message.points:
        raise InputError("JointTrajectory.points: is empty")
    time = np.array([_seconds(point.time_from_start) for point in message.points])
    if time[0] < 0.0 or (np.diff(time) <= 0.0).any():
        raise InputError("JointTrajectory.points: time_from_start has to rise from point to point")
    m, joint = len(reader.names), _rows(message, "positions")[:, order]
    moving = [len(point.velocities) > 0 for point in message.points]
    if any(moving) and not all(moving):
        raise InputError("JointTrajectory.points: velocities at some points only")
    velocity = _rows(message, "velocities")[:, order] if all(moving) else None
    start_s = now_s + (wait_s if message.header.stamp != Time() else 0.0)
    return points_in_order(start_s + time, joint, velocity, m)


def points_in_order(time_s: Array, joint: Array, velocity: Array | None, m: int) -> Points:
    """Split columns into the m robot joints and the pass-through axes behind them."""
    if velocity is None:
        return Points(time_s, joint[:, :m], carried=joint[:, m:])
    return Points(
        time_s, joint[:, :m], velocity[:, :m], carried=joint[:, m:], turning=velocity[:, m:]
    )


def trajectory(
    message: JointTrajectory, points: Points, names: Sequence[str], mark: str
) -> JointTrajectory:
    """Copy the message with new positions and velocities, joints in the order of `names`.

    Only as many names are used as the points have columns.
    """
    joint, velocity = points.whole
    out = JointTrajectory(joint_names=list(names)[: joint.shape[1]])
    out.header.stamp = message.header.stamp
    out.header.frame_id = mark if points.compensated else ""
    for row, point in enumerate(message.points):
        corrected = JointTrajectoryPoint(time_from_start=point.time_from_start)
        corrected.positions = array("d", joint[row])
        if velocity is not None:
            corrected.velocities = array("d", velocity[row])
        out.points.append(corrected)
    return out


def _seconds(duration: Duration) -> float:
    return float(duration.sec) + float(duration.nanosec) / NANOSECONDS


def _rows(message: JointTrajectory, field: str) -> Array:
    """Values of a field at all points, (n, names)."""
    rows = []
    for k, point in enumerate(message.points):
        where, values = f"JointTrajectory.points[{k}].{field}", getattr(point, field)
        if len(values) != len(message.joint_names):
            raise InputError(f"{where}: {len(values)} values for {len(message.joint_names)} names")
        if not np.isfinite(values).all():
            raise InputError(f"{where}: {list(values)}; finite values are needed")
        rows.append(np.array(values, dtype=np.float64))
    return np.array(rows)
