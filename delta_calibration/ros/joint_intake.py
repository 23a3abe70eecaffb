"""Joint positions out of JointState messages as they came over the wire.

A message is converted by rclpy once; those after it that are laid out the same are read at the
places that are known by then. Any other, and one that is not finite, goes the way of the first.
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
    """What is taken out of a JointState."""

    # (m,) [rad] in the robot's order, or (m + k,) with what is passed through behind it
    position: Array
    stamp: Stamp
    frame_id: str
    layout: Layout | None = None  # where this is the first message laid out so


class JointIntake:
    """Reads the JointState messages of one topic.

    The delay of the first message is taken at once.

    Args:
        names: (m,) the robot's joints, in its order.
        passed_through: (k,) axes that a message may have besides, all or none of them.
    """

    def __init__(self, names: Sequence[str], passed_through: Sequence[str] = ()) -> None:
        self._reader = JointReader(names, passed_through)
        self._known: dict[int, tuple[Any, str]] = {}  # by size: what reads them, frame
        example = Bytes(names).message(np.zeros(len(names)), (0, 0))
        for _ in range(2):  # by rclpy, and by the layout that is known then
            self.read(example)
        self._known.clear()

    def read(self, message: bytes) -> Joints:
        """Positions, stamp and frame of a message.

        Raises:
            InputError: it is no JointState, a joint is missing or doubled, sizes differ, or a
                position is not finite.
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
        """Stamp of a message, whatever else is in it; zero where there is none."""
        found = stamp_of(message)
        if found is not None:
            return found
        try:
            header = _typed(message).header
        except InputError:
            return 0, 0
        return int(header.stamp.sec), int(header.stamp.nanosec)

    def _converted(self, message: bytes) -> Joints:
        """What rclpy makes of a message; its layout is kept."""
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
        raise InputError(f"JointState: {len(message)} bytes that are none") from error


def _kernel() -> Any:
    from delta_calibration.cell import wire_kernel

    return wire_kernel
