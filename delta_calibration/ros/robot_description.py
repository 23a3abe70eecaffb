"""Node that publishes the robot for display: its URDF and the states of all its joints.

A closed chain is a tree in URDF, and whoever draws it needs the passive joints' values too. They
come from the mechanism's closure, at a rate for the eye; the measured states are not republished
under their own name, so that nothing else in the cell takes them for the encoders'.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta_calibration.calibration_file import load_calibration
from delta_calibration.description import describe, urdf
from delta_calibration.errors import CalibrationError, ReachError
from delta_calibration.robot import load_robot
from delta_calibration.ros.conversions import JointReader, joint_state
from delta_calibration.ros.diagnostics import Diagnostics
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.parameters import (
    FRAME_PREFIX,
    ROBOT,
    ParameterTable,
    Spec,
    warn_of_unknown,
)
from delta_calibration.ros.qos import MEASURED, STATUS, STREAM_OUT
from delta_calibration.ros.runtime import BaseNode, run
from delta_calibration.ros.throttle import Throttle
from delta_calibration.ros.watchdog import leave

NAME = "robot_description"
ALL_STATES = "joint_states_all"
SAY_AGAIN_S = 5.0  # [s] between two log lines on states that cannot be shown

SPECS = (
    ROBOT,
    Spec(
        "calibration",
        "",
        "calibration file: the robot as identified, and the tracker's frame; may be empty",
        read_only=True,
        path=True,
    ),
    Spec("rate", 30.0, "highest rate [Hz] of joint states", range=(0.1, 200.0), read_only=True),
    FRAME_PREFIX,
)


class RobotDescription(BaseNode):
    """Wires a `Skeleton` to `robot_description` and `joint_states_all`."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        settings = ParameterTable(self, SPECS)
        warn_of_unknown(self)
        robot, file = load_robot(settings.named("robot")), settings.path("calibration")
        known = load_calibration(file, robot) if file else None
        self._skeleton = describe(robot, known)
        self._urdf = urdf(self._skeleton.tree, settings.text("frame_prefix"))
        self._reader = JointReader(robot.joints.names)
        self._last: JointState | None = None  # not shown yet
        self._shown, self._trouble = 0, ""
        self._warnings = Throttle(SAY_AGAIN_S)
        self._out = self.create_publisher(JointState, ALL_STATES, STREAM_OUT)
        self._text = self.create_publisher(String, "robot_description", STATUS)
        self.create_subscription(JointState, "joint_states", self._on_states, MEASURED)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / settings.number("rate"), self._show, clock=steady)
        self._diagnostics = Diagnostics(self, self._report, robot.name)

    def start(self) -> None:
        """Publish the URDF once, latched for late subscribers."""
        self._text.publish(String(data=self._urdf))

    def _on_states(self, message: JointState) -> None:
        self._last = message

    def _show(self) -> None:
        message, self._last = self._last, None
        if message is None:
            return
        try:
            values = self._skeleton.values(self._reader.positions(message)[None])
            every = np.concatenate(list(values.values()))
            if not np.isfinite(every).all():
                raise ReachError("the model cannot be assembled at these joint states")
            self._out.publish(joint_state(tuple(values), every, message.header.stamp))
        except CalibrationError as error:
            self._trouble = str(error)
            if self._warnings.lets():
                self.get_logger().warn(self._trouble)
        else:
            self._shown, self._trouble = self._shown + 1, ""

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        values = {"joint states shown": self._shown, "passive joints": len(self._skeleton.passive)}
        if self._trouble:
            return DiagnosticStatus.WARN, self._trouble, values
        if not self._shown:
            return DiagnosticStatus.WARN, "no joint_states: there is nothing to show", values
        return DiagnosticStatus.OK, "showing", values


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    build: Callable[[], RobotDescription] = RobotDescription
    return run(build, NAME, arguments)


if __name__ == "__main__":
    leave(run_node(NAME))
