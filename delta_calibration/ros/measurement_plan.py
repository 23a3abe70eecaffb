"""Node that drives a machine through a measurement plan and then ends.

Commands follow the plan's times on a steady clock. The motion starts from where the machine
stands, as upstream sees it: `joint_states_nominal` if that is there, else `joint_states`. It ends
where a node that takes the commands is not active any more, or is gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from sensor_msgs.msg import JointState

from delta_calibration.errors import CalibrationError, DataError
from delta_calibration.plans import PLANS, Plan, legs, make_plan
from delta_calibration.plans.named import SEPARATE
from delta_calibration.robot import Robot, load_robot
from delta_calibration.ros.conversions import JointReader, joint_state
from delta_calibration.ros.diagnostics import Diagnostics
from delta_calibration.ros.driven import FAREWELL_S, SETTLE_S, Driven
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.parameters import (
    RATE,
    ROBOT,
    SUBSCRIBERS,
    WAIT_FOR_SUBSCRIBER,
    ParameterTable,
    Spec,
    warn_of_unknown,
)
from delta_calibration.ros.progress import Doing, Progress
from delta_calibration.ros.qos import MEASURED, STREAM_OUT
from delta_calibration.ros.runtime import BaseNode, run
from delta_calibration.ros.watchdog import leave

Array = NDArray[np.float64]

NAME = "measurement_plan"
STATES = ("joint_states_nominal", "joint_states")  # the first that is heard decides the start
STATES_S = 3.0  # [s] to wait for a joint state
HELD_UP_S = 0.25  # [s] delay above which the rest is shifted, as catching up would be a jump

SPECS = (
    ROBOT,
    Spec(
        "plan",
        "line",
        "line, disc, iso9283, identify, separate (or separate:CAUSE,CAUSE), circles, rich, or a "
        "CSV of x_mm, y_mm, z_mm",
        read_only=True,
        path=True,
        names=PLANS,
    ),
    Spec(
        "count",
        0,
        "number of different points; 0: default of the plan",
        (0, 10**5),
        read_only=True,
    ),
    Spec("dwell", 1.0, "time [s] at each stop", range=(0.0, 3600.0), read_only=True),
    Spec("both_sides", True, "approach each point from both sides", read_only=True),
    RATE,
    Spec("radius", 0.45, "radius [m] of the covered region", range=(0.001, 10.0), read_only=True),
    Spec("seed", 0, "seed of the order and of random poses", range=(0, 2**31), read_only=True),
    SUBSCRIBERS,
    WAIT_FOR_SUBSCRIBER,
)


@dataclass(frozen=True)
class Motion:
    """A plan as commands at a constant rate."""

    joint: Array  # (n, m) [rad]
    leg: NDArray[np.intp]  # (n,) number of the stop or path, from 0
    payload: Array  # (n,) [kg] mass that the plan requires on the platform

    @classmethod
    def of(cls, plan: Plan, robot: Robot, rate: float, start: Array | None) -> Motion:
        """Convert a plan to commands at `rate` [1/s], from joint angles `start` (m,) or stop 1."""
        parts = list(legs(plan, robot, rate, start))
        lengths = [len(part.joint) for part in parts]
        return cls(
            np.concatenate([part.joint for part in parts]),
            np.repeat(np.arange(len(parts)), lengths),
            np.repeat([part.payload for part in parts], lengths),
        )

    def __len__(self) -> int:
        return len(self.joint)

    @property
    def leg_count(self) -> int:
        """Total number of stops and paths."""
        return int(self.leg[-1]) + 1


class MeasurementPlan(BaseNode):
    """Publishes a `Motion` in real time."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        self._settings = ParameterTable(self, SPECS)
        warn_of_unknown(self)
        self._robot = load_robot(self._settings.named("robot"))
        self._hz = self._settings.number("rate")
        self._plan = self._read_plan()
        self._commands = self.create_publisher(JointState, "joint_command", STREAM_OUT)
        self._driven = Driven(self, self._commands, self._settings.integer("subscribers"))
        self._stopped = ""  # why the plan was not driven to its end
        self._heard: dict[str, Array] = {}
        self._ears = [
            self.create_subscription(
                JointState,
                name,
                partial(self._on_state, name, JointReader(self._robot.joints.names)),
                MEASURED,
            )
            for name in STATES
        ]
        self._motion: Motion | None = None
        self._next = 0
        self._created = time.monotonic()
        self._found: float | None = None  # when a subscriber was found
        self._begun = 0.0
        self._diagnostics = Diagnostics(self, self._report, self._robot.name)
        self._progress = Progress(self, self._doing)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._ticker = self.create_timer(1.0 / self._hz, self._tick, clock=steady)

    def close(self) -> None:
        """Wait for the last command to arrive, and publish the final state."""
        self._commands.wait_for_all_acked(Duration(seconds=FAREWELL_S))
        self._diagnostics.publish()
        self._progress.publish()

    def _read_plan(self) -> Plan:
        settings = self._settings
        plan = settings.text("plan")
        return make_plan(
            plan if plan.startswith(f"{SEPARATE}:") else settings.named("plan"),
            self._robot,
            count=settings.integer("count") or None,
            dwell=settings.number("dwell"),
            both_sides=settings.flag("both_sides"),
            radius=settings.number("radius"),
            seed=settings.integer("seed"),
        )

    def _on_state(self, name: str, reader: JointReader, message: JointState) -> None:
        try:
            self._heard[name] = reader.positions(message)
        except CalibrationError as error:
            self.get_logger().warn(f"{name}: {error}", once=True)

    def _tick(self) -> None:
        if self.finished.done():
            return
        try:
            if self._motion is None:
                self._motion = self._ready(time.monotonic())
                self._begun = time.monotonic()  # computing the motion took time
            if self._motion is not None:
                self._drive(self._motion, time.monotonic())
        except CalibrationError as error:
            self._stopped = str(error)
            self.fail(error)

    def _ready(self, now: float) -> Motion | None:
        """Compute the motion once a subscriber is ready and the machine's position is known.

        Raises:
            DataError: there was no subscriber in time, or it was not active.
        """
        self._driven.forget()
        trouble = self._driven.trouble()
        if trouble:
            self._found = None
            self._require_patience(now, trouble)
            return None
        self._found = now if self._found is None else self._found
        waited = now - self._found
        unknown = not self._heard or not self._driven.known()
        if waited < SETTLE_S or (unknown and waited < STATES_S):
            return None
        start = next((self._heard[name] for name in STATES if name in self._heard), None)
        if start is None:
            self.get_logger().warn("no joint states: the motion begins at the first stop")
        for ear in self._ears:
            self.destroy_subscription(ear)
        motion = Motion.of(self._plan, self._robot, self._hz, start)
        self.get_logger().info(
            f"plan {self._plan.name}: {motion.leg_count} stops and paths, "
            f"{len(motion) / self._hz:.0f} s"
        )
        return motion

    def _require_patience(self, now: float, trouble: str) -> None:
        limit = self._settings.number("wait_for_subscriber")
        if now - self._created >= limit:
            raise DataError(f"did not begin in {limit:g} s: {trouble}")

    def _drive(self, motion: Motion, now: float) -> None:
        """Send the commands that are due: command k at k / rate, at most half a period early.

        Raises:
            DataError: the commands no longer reach the drives.
        """
        trouble = self._driven.lasting_trouble()
        if trouble:
            at = int(motion.leg[max(self._next - 1, 0)]) + 1
            raise DataError(f"stopped at {at} of {motion.leg_count}: {trouble}")
        late = now - self._begun - self._next / self._hz
        if late > HELD_UP_S:
            self._begun += late
            self.get_logger().warn(f"delayed: the rest of the plan is {late:.2f} s later")
        due = int((now - self._begun) * self._hz + 0.5) + 1
        for k in range(self._next, min(due, len(motion))):
            self._announce(motion, k)
            stamp = self.get_clock().now().to_msg()
            self._commands.publish(joint_state(self._robot.joints.names, motion.joint[k], stamp))
            self._next = k + 1
        if due > len(motion):  # one period after the last command, which is held so long
            self.get_logger().info(f"plan {self._plan.name}: done")
            self.finish()

    def _announce(self, motion: Motion, k: int) -> None:
        """Log the payload where it changes, and progress in tenths."""
        if motion.payload[k] != (motion.payload[k - 1] if k else 0.0):
            self.get_logger().warn(
                f"the plan needs {motion.payload[k]:g} kg on the platform from here on; "
                "it does not wait for it"
            )
        tenth = max(motion.leg_count // 10, 1)
        begins = k == 0 or motion.leg[k] != motion.leg[k - 1]
        if begins and motion.leg[k] % tenth == 0:
            self.get_logger().info(f"{motion.leg[k] + 1} of {motion.leg_count}")

    def _doing(self) -> Doing:
        """Progress of the plan, for `~/progress`."""
        motion = self._motion
        if motion is None or self._next == len(motion):
            return {}
        _, said, values = self._report()
        return {"plan": (said, {**values, "done [%]": f"{100 * self._next / len(motion):.0f}"})}

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        motion = self._motion
        values: dict[str, object] = {"plan": self._plan.name}
        if self._stopped:
            return DiagnosticStatus.ERROR, self._stopped, values
        if motion is None:
            return (
                DiagnosticStatus.OK,
                f"waiting: {self._driven.trouble() or 'about to begin'}",
                values,
            )
        current = int(motion.leg[max(self._next - 1, 0)]) + 1
        values["stop"], values["stops"] = current, motion.leg_count
        values["left [s]"] = f"{(len(motion) - self._next) / self._hz:.1f}"
        if self._next == len(motion):
            return DiagnosticStatus.OK, "done", values
        return DiagnosticStatus.OK, f"at {current} of {motion.leg_count}", values


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node to the end of the plan, or until it is stopped; returns the exit code."""
    build: Callable[[], MeasurementPlan] = MeasurementPlan
    return run(build, NAME, arguments)


if __name__ == "__main__":
    leave(run_node(NAME))
