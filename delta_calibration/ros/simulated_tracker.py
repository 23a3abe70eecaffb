"""Node that simulates a cell: a machine with manufacturing errors and a tracker in front of it.

It answers commands with encoder and tracker readings. What the machine truly is, it keeps to
itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import InertiaStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState, Temperature

from delta_calibration.description import TOOL, TRACKER, frame_prefix
from delta_calibration.errors import CalibrationError
from delta_calibration.robot import load_robot
from delta_calibration.ros.conversions import (
    JointReader,
    joint_state,
    payload,
    pose_stamped,
    stamp_to_ns,
)
from delta_calibration.ros.diagnostics import Diagnostics
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.parameters import (
    FRAME_PREFIX,
    ROBOT,
    ParameterTable,
    Spec,
    warn_of_unknown,
)
from delta_calibration.ros.qos import BY_NAME, COMMAND
from delta_calibration.ros.runtime import BaseNode, run
from delta_calibration.ros.simulated_machine import SimulatedMachine, without_noise
from delta_calibration.ros.throttle import Throttle
from delta_calibration.ros.watchdog import leave
from delta_calibration.simulation import WARM_UP, Climate, draw_machine, effect_options

NAME = "simulated_tracker"
TEMPERATURE_PERIOD_S = 1.0  # [s]
SAY_AGAIN_S = 2.0  # [s] between two log lines on refused commands

SPECS = (
    ROBOT,
    Spec(
        "seed",
        0,
        "seed of the random numbers: the machine and its noise",
        (0, 2**31),
        read_only=True,
    ),
    Spec(
        "scatter",
        1.0,
        "size of the manufacturing errors; 1 draws them from the tolerances, 0 makes a nominal "
        "machine",
        range=(0.0, 10.0),
        read_only=True,
    ),
    Spec("rate", 50.0, "rate [Hz] of encoders and tracker", range=(1.0, 1000.0), read_only=True),
    Spec("noise", True, "whether joints, encoders and tracker have noise", read_only=True),
    Spec(
        "effects",
        ("",),
        "causes to hide in the machine, as in delta-cal simulate: NAME:key=value,key=value",
        read_only=True,
    ),
    Spec(
        "warm_up",
        WARM_UP,
        "time constant [s] of the arms' warm-up; without thermal growth the temperature is "
        "constant",
        range=(1.0, 1e6),
        read_only=True,
    ),
    FRAME_PREFIX,
)


class SimulatedTracker(BaseNode):
    """Wires a `SimulatedMachine` to the cell's topics.

    It follows the commands to the drives, and carries the payload that is published.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        settings = ParameterTable(self, SPECS)
        warn_of_unknown(self)
        self._prefix = frame_prefix(settings.text("frame_prefix"))
        robot = load_robot(settings.named("robot"))
        seed = settings.integer("seed")
        drawn = robot if settings.flag("noise") else without_noise(robot)
        hidden = [effect_options(text) for text in settings.texts("effects") if text != "none"]
        machine = draw_machine(drawn, seed, settings.number("scatter"), hidden)
        rng = np.random.default_rng([seed, 1])
        climate = Climate(machine.warms, settings.number("warm_up"))
        self._simulated = SimulatedMachine(machine, rng, time.monotonic(), climate)
        self._reader = JointReader(robot.joints.names)
        self._followed = self._refused = 0
        self._trouble = ""  # why the last command was not followed
        self._warnings = Throttle(SAY_AGAIN_S)
        self._states = self._publisher("joint_states")
        self._poses = self._publisher("tracker/pose")
        self._heat = self._publisher("cell/temperature")
        self._load = self._publisher("cell/payload")
        self.create_subscription(
            JointState, "joint_command_compensated", self._on_command, COMMAND
        )
        topic = BY_NAME["cell/payload"]
        self.create_subscription(topic.message, topic.name, self._on_payload, topic.reader)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / settings.number("rate"), self._measure, clock=steady)
        self.create_timer(TEMPERATURE_PERIOD_S, self._say_temperatures, clock=steady)
        self._diagnostics = Diagnostics(self, self._report, robot.name)
        state = "warming up from 20 deg C" if machine.warms else "at 20 deg C"
        self.get_logger().info(f"machine {seed} of {robot.name}, {state}")

    def start(self) -> None:
        """Publish an empty payload and the temperatures."""
        message = InertiaStamped()
        message.header.stamp = self._now()
        message.header.frame_id = self._prefix + TOOL
        self._load.publish(message)
        self._say_temperatures()

    def _publisher(self, name: str) -> Publisher:
        return self.create_publisher(BY_NAME[name].message, name, BY_NAME[name].writer)

    def _now(self) -> Time:
        return self.get_clock().now().to_msg()

    def _on_command(self, message: JointState) -> None:
        try:
            joint = self._reader.positions(message)
            sent = stamp_to_ns(message.header.stamp) * 1e-9 or None  # without stamp: arrival time
            self._simulated.command(joint, time.monotonic(), sent)
        except CalibrationError as error:
            self._refuse(error)
        else:
            self._followed += 1
            self._trouble = ""

    def _on_payload(self, message: InertiaStamped) -> None:
        try:
            _, mass, centre = payload(message)
        except CalibrationError as error:
            self.get_logger().warn(
                f"payload as before: {error}", throttle_duration_sec=SAY_AGAIN_S
            )
        else:
            self._simulated.carry(mass, centre)

    def _measure(self) -> None:
        """Publish one reading of encoders and tracker with the same stamp."""
        stamp = self._now()
        try:
            seen = self._simulated.measure(time.monotonic())
        except CalibrationError as error:
            self._refuse(error)
            seen = self._simulated.measure()  # where it stayed
        self._states.publish(joint_state(self._reader.names, seen.joint, stamp))
        frame = self._prefix + TRACKER
        self._poses.publish(pose_stamped(seen.position, seen.quaternion, stamp, frame))

    def _refuse(self, error: CalibrationError) -> None:
        self._refused += 1
        self._trouble = str(error)
        if self._warnings.lets():
            self.get_logger().warn(f"pose held: {error}")

    def _say_temperatures(self) -> None:
        for part, celsius in self._simulated.temperatures(time.monotonic()).items():
            message = Temperature(temperature=celsius)
            message.header.stamp = self._now()
            message.header.frame_id = part
            self._heat.publish(message)

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        values = {"commands followed": self._followed, "commands refused": self._refused}
        if self._trouble:
            return DiagnosticStatus.WARN, f"pose held: {self._trouble}", values
        if not self._followed:
            return DiagnosticStatus.OK, "at home: no command yet", values
        return DiagnosticStatus.OK, "following", values


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    build: Callable[[], SimulatedTracker] = SimulatedTracker
    return run(build, NAME, arguments)


if __name__ == "__main__":
    leave(run_node(NAME))
