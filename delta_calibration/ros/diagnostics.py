"""Publisher of a node's state on `/diagnostics`, once a second, independent of simulated time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from delta_calibration.ros.qos import DIAGNOSTICS
from delta_calibration.texts import bounded

PERIOD_S = 1.0


def status(
    level: bytes,
    name: str,
    message: str,
    values: Mapping[str, object] | None = None,
    hardware: str = "",
) -> DiagnosticStatus:
    """Make a status; `level` is one of DiagnosticStatus.OK, WARN, ERROR, STALE.

    Texts are truncated, because they may contain names given by peers.
    """
    given = (values or {}).items()
    pairs = [KeyValue(key=bounded(key), value=bounded(str(value))) for key, value in given]
    message = bounded(message)
    return DiagnosticStatus(
        level=level, name=name, message=message, values=pairs, hardware_id=hardware
    )


class Diagnostics:
    """Publishes what `report` returns at 1 Hz of wall time.

    Args:
        node: node that is reported on; its full name is the name of the status.
        report: function that returns the present level, message and values.
        hardware: hardware id, such as the robot's name; may be set later.
    """

    def __init__(
        self,
        node: Node,
        report: Callable[[], tuple[bytes, str, Mapping[str, object]]],
        hardware: str = "",
    ) -> None:
        self._node = node
        self._report = report
        self.hardware = hardware
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", DIAGNOSTICS)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD_S, self.publish, clock=clock)

    def publish(self) -> None:
        """Publish the state now, in addition to the periodic messages."""
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        level, text, values = self._report()
        name = self._node.get_fully_qualified_name()
        message.status = [status(level, name, text, values, self.hardware)]
        self._publisher.publish(message)
