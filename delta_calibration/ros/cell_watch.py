"""Listen to the calibration nodes of a cell, and write what they say as lines of JSON.

    python -m delta_calibration.ros.cell_watch

A line a node and second: its name, level (`ok`, `warn`, `error`), sentence, robot, figures, and a
sentence for each task that it is at. For the bench in a browser, which keeps ROS out of its own
process. It sends nothing and calls nothing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from delta_calibration.access import CALIBRATION_NODE
from delta_calibration.ros.progress import IDLE
from delta_calibration.ros.qos import DIAGNOSTICS, STATUS
from delta_calibration.ros.runtime import BaseNode, run
from delta_calibration.ros.watchdog import leave

NAME = "cell_watch"
PERIOD_S = 1.0
LEVELS = {DiagnosticStatus.OK: "ok", DiagnosticStatus.WARN: "warn"}
_PROGRESS = f"/{CALIBRATION_NODE}/progress"


class CellWatch(BaseNode):
    """Writes a line for each status of a calibration node, with the tasks of the node."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        self._doing: dict[str, list[str]] = {}  # by the node's full name
        self._listening: dict[str, Any] = {}
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_status, DIAGNOSTICS)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD_S, self._look, clock=steady)

    def _look(self) -> None:
        """Subscribe to the progress of nodes that appeared since the last call."""
        for topic, _ in self.get_topic_names_and_types():
            if topic.endswith(_PROGRESS) and topic not in self._listening:
                node = topic.removesuffix("/progress")
                heard = partial(self._on_progress, node)
                self._listening[topic] = self.create_subscription(
                    DiagnosticArray, topic, heard, STATUS
                )

    def _on_progress(self, node: str, message: Any) -> None:
        self._doing[node] = [
            _told(status.name.rpartition("/")[2], status)
            for status in message.status
            if status.message != IDLE
        ]

    def _on_status(self, message: Any) -> None:
        for status in message.status:
            if status.name.rpartition("/")[2] == CALIBRATION_NODE:
                line = json.dumps(self._line(status))
                sys.stdout.write(f"{line}\n")
        sys.stdout.flush()

    def _line(self, status: Any) -> dict[str, object]:
        return {
            "node": status.name,
            "level": LEVELS.get(status.level, "error"),
            "message": status.message,
            "robot": status.hardware_id,
            "values": {pair.key: pair.value for pair in status.values},
            "doing": self._doing.get(status.name, []),
        }


def _told(task: str, status: Any) -> str:
    """Describe a task in a sentence: `fit: geometry (step 3 of 4, elapsed [s] 2.0)`."""
    figures = ", ".join(f"{pair.key} {pair.value}" for pair in status.values)
    return f"{task}: {status.message}" + (f" ({figures})" if figures else "")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    return run(CellWatch, NAME, arguments)


if __name__ == "__main__":
    leave(main())
