"""Conversion of messages to arrays and back; results are finite, complete and in robot order."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import InertiaStamped, PointStamped, PoseStamped
from numpy.typing import NDArray
from sensor_msgs.msg import JointState, Temperature

from delta_calibration.cell.usual import named_in
from delta_calibration.errors import InputError
from delta_calibration.texts import listed

Array = NDArray[np.float64]
NANOSECONDS = 1_000_000_000
LONGEST_PART = 100  # longest name [characters] of a part with a temperature
UNIT_TOLERANCE = 1e-3  # on the length of a quaternion: single-precision trackers stay well inside


def stamp_to_ns(stamp: Time) -> int:
    """Nanoseconds of a message's stamp."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def ns_to_stamp(time_ns: int) -> Time:
    """Message stamp from nanoseconds."""
    seconds, nanoseconds = divmod(int(time_ns), NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


class JointReader:
    """Reads joint positions in the robot's order from messages in any order.

    The order is looked up only when a message's names change. Joints that are not the robot's (a
    gripper on the same topic) are ignored.

    Args:
        names: (m,) names of the robot's joints, in its order.
        passed_through: (k,) names of pass-through axes, read behind the joints if present.
    """

    def __init__(self, names: Sequence[str], passed_through: Sequence[str] = ()) -> None:
        self.names, self.passed_through = tuple(names), tuple(passed_through)
        self._seen: list[str] | None = None
        self._order: list[int] = []

    def positions(self, message: JointState) -> Array:
        """Positions of the robot's joints, (m,) [rad], or with the pass-through axes, (m + k,).

        Raises:
            InputError: a joint is missing or doubled, only a part of the pass-through axes is
                present, sizes differ, or a position is not finite.
        """
        if message.name != self._seen:
            self._order = self._find(list(message.name))
            self._seen = list(message.name)
        if len(message.position) != len(self._seen or ()):
            raise InputError(
                f"JointState: {len(message.position)} positions for "
                f"{len(message.name)} names {listed(message.name)}"
            )
        angles = [message.position[k] for k in self._order]
        every = self.names + self.passed_through
        return _finite(np.array(angles), "JointState.position", every)

    def order(self, names: Sequence[str]) -> list[int]:
        """Index in `names` of each of the robot's joints, and of the pass-through axes if present.

        Raises:
            InputError: a joint or pass-through axis is missing or doubled.
        """
        return self._find(list(names))

    def _find(self, found: list[str]) -> list[int]:
        if any(found.count(name) != 1 for name in self.names):
            raise InputError(
                f"JointState: expected each of the joints {list(self.names)} once, "
                f"found {listed(found)}"
            )
        told = named_in(found, self.names, self.passed_through)
        return [found.index(name) for name in told]


def joint_state(names: Sequence[str], position: Array, stamp: Time) -> JointState:
    """Message with the positions (m,) [rad] of the named joints.

    Raises:
        InputError: numbers of names and positions differ, or a position is not finite.
    """
    if position.shape != (len(names),):
        raise InputError(f"JointState: {position.shape} positions for the names {list(names)}")
    message = JointState()
    message.header.stamp = stamp
    message.name = list(names)
    message.position = array("d", _finite(position, "JointState.position", names).tolist())
    return message


class JointWriter:
    """Writer of a stream of joint positions that reuses one message object.

    Publishing copies the message, so that it can be refilled at once. To keep a message, use
    `joint_state`.

    Args:
        names: (m,) names of the joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._message = JointState(name=list(names))

    def message(self, position: Array, stamp: Time, frame_id: str = "") -> JointState:
        """Message with the positions (m,) [rad].

        Raises:
            InputError: numbers of names and positions differ, or a position is not finite.
        """
        if position.shape != (len(self._names),):
            raise InputError(
                f"JointState: {position.shape} positions for the names {list(self._names)}"
            )
        _finite(position, "JointState.position", self._names)
        header = self._message.header
        header.stamp, header.frame_id = stamp, frame_id
        self._message.position = array("d", position.tolist())
        return self._message


@dataclass(frozen=True)
class TrackerReading:
    """One reading in the tracker's frame: position (3,) [m]; quaternion (4,) x y z w, or None."""

    stamp_ns: int
    position: Array
    quaternion: Array | None = None


def tracker_pose(message: PoseStamped, position_only: bool = False) -> TrackerReading:
    """Reading of a probe, or of a reflector reported as a pose (`position_only`).

    Raises:
        InputError: not finite, or a quaternion whose length is not 1.
    """
    position = _point(message.pose.position, "PoseStamped.pose.position")
    stamp_ns = stamp_to_ns(message.header.stamp)
    if position_only:
        return TrackerReading(stamp_ns, position)
    return TrackerReading(stamp_ns, position, _unit_quaternion(message.pose.orientation))


def tracker_point(message: PointStamped) -> TrackerReading:
    """Reading of a reflector.

    Raises:
        InputError: not finite.
    """
    position = _point(message.point, "PointStamped.point")
    return TrackerReading(stamp_to_ns(message.header.stamp), position)


def pose_stamped(
    position: Array, quaternion: Array, stamp: Time, frame: str = "tracker"
) -> PoseStamped:
    """Message with position (3,) [m] and quaternion (4,) x y z w.

    Raises:
        InputError: not finite.
    """
    message = PoseStamped()
    message.header.stamp = stamp
    message.header.frame_id = frame
    target = message.pose
    p = _finite(position, "PoseStamped.pose.position", "xyz")
    q = _finite(quaternion, "PoseStamped.pose.orientation", "xyzw")
    target.position.x, target.position.y, target.position.z = p.tolist()
    target.orientation.x, target.orientation.y, target.orientation.z = q[:3].tolist()
    target.orientation.w = float(q[3])
    return message


def temperature(message: Temperature) -> tuple[str, int, float]:
    """Part the sensor is fixed to, stamp [ns], and temperature [deg C].

    Raises:
        InputError: `frame_id`, the name of the part, is empty or too long; value not finite.
    """
    part = str(message.header.frame_id)
    if len(part) > LONGEST_PART:
        raise InputError(
            f"Temperature.header.frame_id: {listed([part])[1:-1]} has {len(part)} characters; the "
            f"name of a part has at most {LONGEST_PART}"
        )
    if not part:
        raise InputError("Temperature.header.frame_id: is empty; it names the part, such as 'arm'")
    value = _finite(
        np.array([message.temperature]), "Temperature.temperature", [listed([part])[1:-1]]
    )
    return part, stamp_to_ns(message.header.stamp), float(value[0])


def payload(message: InertiaStamped) -> tuple[int, float, Array]:
    """Stamp [ns], mass [kg] and centre of mass (3,) [m] of the payload.

    Raises:
        InputError: not finite, or a negative mass.
    """
    mass = float(_finite(np.array([message.inertia.m]), "InertiaStamped.inertia.m", ["m"])[0])
    if mass < 0.0:
        raise InputError(f"InertiaStamped.inertia.m: {mass} kg, must not be negative")
    return stamp_to_ns(message.header.stamp), mass, _point(message.inertia.com, "inertia.com")


def _point(point: Any, field: str) -> Array:
    return _finite(np.array([point.x, point.y, point.z]), field, "xyz")


def _unit_quaternion(value: Any) -> Array:
    field = "PoseStamped.pose.orientation"
    q = _finite(np.array([value.x, value.y, value.z, value.w]), field, "xyzw")
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise InputError(f"{field}: length {length:.6g}, must be 1 within {UNIT_TOLERANCE}")
    return np.asarray(q / length, dtype=np.float64)


def _finite(values: Array, field: str, labels: Sequence[str]) -> Array:
    """Return the values as floats, or raise an error that names those that are not finite."""
    if not all(map(isfinite, values.tolist())):
        bad = np.flatnonzero(~np.isfinite(values))
        named = ", ".join(f"{labels[int(i)]} = {values[i]}" for i in bad)
        raise InputError(f"{field}: {named}; finite values are needed")
    return np.asarray(values, dtype=np.float64)
