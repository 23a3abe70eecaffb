"""How far a node's work has come, on `~/progress`: a status a task, latched."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from delta_calibration.ros.diagnostics import status
from delta_calibration.ros.qos import STATUS

PERIOD_S = 0.5
IDLE = "idle"

Doing = Mapping[str, tuple[str, Mapping[str, object]]]  # task -> sentence, figures


class Progress:
    """Publishes what a node is at, twice a second while there is something, and once at its end.

    What takes less than half a second is told by who calls `publish` at its beginning.

    Args:
        node: whose work it is; its name comes before the task's.
        doing: gives the tasks that go on now.
    """

    def __init__(self, node: Node, doing: Callable[[], Doing]) -> None:
        self._node, self._doing = node, doing
        self._last: frozenset[str] | None = None  # tasks told; None before the first time
        self._publisher = node.create_publisher(DiagnosticArray, "~/progress", STATUS)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD_S, self.publish, clock=clock)

    def publish(self) -> None:
        """Tell it now, if there is anything to tell."""
        doing = self._doing()
        tasks = frozenset(doing)
        if not tasks and self._last == tasks:
            return
        name = self._node.get_fully_qualified_name()
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [
            status(DiagnosticStatus.OK, f"{name}/{task}", *said) for task, said in doing.items()
        ] or [status(DiagnosticStatus.OK, name, IDLE)]
        self._publisher.publish(message)
        self._last = tasks
