"""Publisher of the progress of a node's tasks on `~/progress`: one latched status a task."""

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
    """Publishes the tasks of a node twice a second while there are any, and once at the end.

    To show a task of less than half a second, call `publish` at its beginning.

    Args:
        node: node that does the work; its name precedes the name of the task.
        doing: function that returns the present tasks.
    """

    def __init__(self, node: Node, doing: Callable[[], Doing]) -> None:
        self._node, self._doing = node, doing
        self._last: frozenset[str] | None = None  # tasks published last; None before that
        self._publisher = node.create_publisher(DiagnosticArray, "~/progress", STATUS)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD_S, self.publish, clock=clock)

    def publish(self) -> None:
        """Publish the tasks now, unless the node is idle and was so before."""
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
