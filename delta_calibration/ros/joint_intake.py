"""Reading of joint positions from serialized JointState messages.

The first message of a layout is deserialized by rclpy; later ones of the same layout are read
directly at the known byte offsets. Others, and those not finite, are deserialized as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from delta_calibration.cell.joint_bytes import Bytes, Layout, stamp_of
from delta_calibration.cell.usual import named_in, wire_of
from delta_calibration.errors import InputError
from delta_calibration.ros.conversions import NANOSECONDS, JointReader

Array = NDArray[np.float64]
Stamp = tuple[int, int]  # seconds, nanoseconds

_KEPT = 4  # layouts


@dataclass(frozen=True)
class Joints:
    """Content read from a JointState."""

    # (m,) [rad] in the robot's order, or (m + k,) with the pass-through axes behind
    position: Array
    stamp: Stamp
    frame_id: str
    layout: Layout | None = None  # set if rclpy deserialized the message; otherwise None


class JointIntake:
    """Reads the JointState messages of one topic.

    The constructor reads an example, so that the first real message is not delayed.

    Args:
        names: (m,) names of the robot's joints, in its order.
        passed_through: (k,) names of pass-through axes; a message contains all or none of them.
    """

    def __init__(self, names: Sequence[str], passed_through: Sequence[str] = ()) -> None:
        self._reader = JointReader(names, passed_through)
        self._known: dict[int, tuple[Any, str]] = {}  # by size: layout for compiled code, frame
        example = Bytes(names).message(np.zeros(len(names)), (0, 0))
        for _ in range(2):  # by rclpy, then by the layout known from it
            self.read(example)
        self._known.clear()

    def read(self, message: bytes) -> Joints:
        """Read positions, stamp and frame of a message.

        Raises:
            InputError: it is no JointState, a joint is missing or doubled, only a part of the
                pass-through axes is present, sizes differ, or a position is not finite.
        """
        known = self._known.get(len(message))
        if known is not None:
            wire, frame_id = known
            q = np.empty(len(wire.position))
            stamp = stamp_of(message)
            if stamp is not None and _kernel().read(wire, message, q):
                return Joints(q, stamp, frame_id)
        return self._converted(message)

    def stamp(self, message: bytes) -> Stamp:
        """Read the stamp of a message, even of one with invalid content; zero if it has none."""
        found = stamp_of(message)
        if found is not None:
            return found
        try:
            header = _typed(message).header
        except InputError:
            return 0, 0
        return int(header.stamp.sec), int(header.stamp.nanosec)

    def _converted(self, message: bytes) -> Joints:
        """Deserialize a message by rclpy, and remember its layout."""
        typed = _typed(message)
        q, header = self._reader.positions(typed), typed.header
        layout = Layout.of(message)
        if layout is not None:
            self._known.pop(layout.size, None)
            told = named_in(layout.names, self._reader.names, self._reader.passed_through)
            self._known[layout.size] = wire_of(layout, message, told), layout.frame_id
            if len(self._known) > _KEPT:
                del self._known[next(iter(self._known))]
        stamp = int(header.stamp.sec), int(header.stamp.nanosec)
        return Joints(q, stamp, str(header.frame_id), layout)


def nanoseconds(stamp: Stamp) -> int:
    """A stamp in nanoseconds."""
    return stamp[0] * NANOSECONDS + stamp[1]


def _typed(message: bytes) -> JointState:
    try:
        return deserialize_message(message, JointState)
    except (RuntimeError, MemoryError, ValueError) as error:
        raise InputError(f"JointState: {len(message)} bytes that cannot be decoded") from error


def _kernel() -> Any:
    from delta_calibration.cell import wire_kernel

    return wire_kernel
