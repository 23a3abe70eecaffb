"""Node that corrects points with the tracker alone, without a model, and writes the commands.

Its commands are nominal ones and go to `joint_command`, like those of any motion controller: the
calibration node stays the only one that commands the drives, with its guards, and a recorder hears
what was asked. Compensation has to be off: the corrections are what a nominal command needs, and a
machine whose encoders do not show the command is not searched on.

Each stop is approached from the same side, so that play is taken up in the same way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from sensor_msgs.msg import JointState

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.cell.positioning import (
    Outcome,
    Positioning,
    require_outcomes,
    write_outcomes,
)
from delta_calibration.cell.stop_detector import StopDetector
from delta_calibration.compensation.grid_search import Stop
from delta_calibration.compensation.joint_lattice import GridSettings
from delta_calibration.errors import CalibrationError, DataError, InputError
from delta_calibration.plans import Plan, legs, read_targets
from delta_calibration.robot import Robot, load_robot
from delta_calibration.ros.conversions import (
    JointReader,
    TrackerReading,
    joint_state,
    tracker_point,
    tracker_pose,
)
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
from delta_calibration.ros.qos import MEASURED, STREAM_OUT
from delta_calibration.ros.runtime import BaseNode, run
from delta_calibration.ros.throttle import Throttle
from delta_calibration.ros.watchdog import leave

Array = NDArray[np.float64]

NAME = "grid_positioner"
SAY_AGAIN_S = 2.0  # [s] between two log lines on refused messages of a topic
ENCODER_SIGMAS = 8.0  # allowed deviation of a joint at rest, in standard deviations of its encoder

SPECS = (
    ROBOT,
    Spec(
        "points",
        "",
        "CSV file with columns x_mm, y_mm, z_mm: tool points",
        read_only=True,
        path=True,
    ),
    Spec(
        "output",
        "corrections.csv",
        "CSV file for the corrected commands",
        read_only=True,
        path=True,
    ),
    Spec(
        "calibration",
        "",
        "calibration file with the tracker frame; empty: the frame is found from stops first",
        read_only=True,
        path=True,
    ),
    Spec(
        "frame_stops",
        24,
        "number of stops for finding the tracker's frame",
        (4, 1000),
        read_only=True,
    ),
    Spec(
        "repeats",
        3,
        "number of searches per point, whose results are averaged",
        (2, 100),
        read_only=True,
    ),
    Spec(
        "unit_deg",
        0.01,
        "one command unit [deg] of each joint; a sliding joint moves about as far",
        (1e-6, 1.0),
        read_only=True,
    ),
    Spec(
        "spacing", 16, "spacing of the first lattice in command units", (1, 1024), read_only=True
    ),
    Spec(
        "visits",
        2,
        "largest number of times that a stop is measured, if stops are equally good",
        (1, 100),
        read_only=True,
    ),
    Spec(
        "every_node",
        False,
        "measure all neighbours (26 with three joints), without using predictions",
        read_only=True,
    ),
    Spec("most_moves", 300, "largest number of stops in a search", (1, 10**6), read_only=True),
    Spec(
        "largest_deg",
        0.0,
        "largest correction [deg] of a joint; 0: value of the robot file",
        (0.0, 10.0),
        read_only=True,
    ),
    Spec(
        "noise_mm",
        0.0,
        "standard uncertainty [mm] of a coordinate at a stop; 0: from the robot file",
        (0.0, 10.0),
        read_only=True,
    ),
    Spec(
        "readings", 10, "number of tracker readings averaged at a stop", (1, 10**5), read_only=True
    ),
    Spec(
        "dwell",
        0.3,
        "time [s] to settle at a stop before readings are used",
        (0.0, 3600.0),
        read_only=True,
    ),
    Spec("patience", 10.0, "time limit [s] for measuring a stop", (0.1, 3600.0), read_only=True),
    RATE,
    SUBSCRIBERS,
    WAIT_FOR_SUBSCRIBER,
)


class GridPositioner(BaseNode):
    """Wires a `Positioning` to the cell: sends its steps as commands, returns readings at rest."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        self._settings = ParameterTable(self, SPECS)
        warn_of_unknown(self)
        self._robot = load_robot(self._settings.named("robot"))
        size = self._robot.commanded.joint_size
        self._unit = float(np.radians(self._settings.number("unit_deg"))) * size
        self._positioning = self._make_positioning()
        self._said = 0  # number of outcomes logged and written
        self._moves = 0
        self._here: Array | None = None  # position of the machine, then its last target
        self._motion: list[Array] = []  # commands still to be sent
        self._standing: StopDetector | None = None
        self._last: Array | None = None  # mean reading at the stop before
        self._created = self._arrived = time.monotonic()
        self._found: float | None = None  # when a subscriber was found
        self._commands = self.create_publisher(JointState, "joint_command", STREAM_OUT)
        self._driven = Driven(self, self._commands, self._settings.integer("subscribers"))
        self._stopped = ""  # why it ended before all points were done
        self._reader = JointReader(self._robot.joints.names)
        self._listen(JointState, "joint_states", self._on_states)
        self._listen(PoseStamped, "tracker/pose", self._on_pose)
        self._listen(PointStamped, "tracker/point", lambda m: self._on_reading(tracker_point(m)))
        self._diagnostics = Diagnostics(self, self._report, self._robot.name)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        period = 1.0 / self._settings.number("rate")
        self._ticker = self.create_timer(period, self._tick, clock=steady)

    def close(self) -> None:
        """Wait for the last command to arrive, and publish the final state."""
        self._commands.wait_for_all_acked(Duration(seconds=FAREWELL_S))
        self._diagnostics.publish()

    def _make_positioning(self) -> Positioning:
        s, joints, size = self._settings, self._robot.joints, self._robot.commanded.joint_size
        if not s.text("points"):
            raise InputError("parameter points: needed, a CSV file with columns x_mm, y_mm, z_mm")
        require_outcomes(Path(s.named("output")), joints.names)  # before anything moves
        m = len(joints.names)
        lattice = GridSettings(
            unit=np.full(m, self._unit),
            lower=joints.lower,
            upper=joints.upper,
            bound=size * np.radians(s.number("largest_deg")) or self._robot.limits.correction,
            noise=1e-3 * s.number("noise_mm"),
            spacing=s.integer("spacing"),
            visits=s.integer("visits"),
            every_node=s.flag("every_node"),
            most_moves=s.integer("most_moves"),
        )
        return Positioning(
            self._robot,
            read_targets(Path(s.named("points")), self._robot).point,
            lattice,
            s.integer("repeats"),
            s.integer("readings"),
            self._frame(self._robot, s),
        )

    @staticmethod
    def _frame(robot: Robot, settings: ParameterTable) -> Calibration | int:
        """Calibration that contains the tracker's frame, or number of stops to determine it."""
        file = settings.path("calibration")
        return load_calibration(file, robot) if file else settings.integer("frame_stops")

    # --- topics

    def _listen(self, kind: Any, topic: str, take: Callable[[Any], None]) -> None:
        warnings = Throttle(SAY_AGAIN_S)

        def receive(message: Any) -> None:
            try:
                take(message)
            except CalibrationError as error:
                if warnings.lets():
                    self.get_logger().warn(f"{topic}: {error}")

        self.create_subscription(kind, topic, receive, MEASURED)

    def _on_states(self, message: JointState) -> None:
        position = self._reader.positions(message)
        if self._here is None:
            self._here = position
        if self._standing is not None:
            self._standing.joints(position)

    def _on_pose(self, message: PoseStamped) -> None:
        reflector = self._robot.tracker.measures == "position"
        self._on_reading(tracker_pose(message, position_only=reflector))

    def _on_reading(self, reading: TrackerReading) -> None:
        if self._standing is not None:
            self._standing.reading(reading.position)

    # --- motion

    def _tick(self) -> None:
        if self.finished.done():
            return
        try:
            self._advance(time.monotonic())
        except CalibrationError as error:
            self._stopped = str(error)
            self.fail(error)

    def _advance(self, now: float) -> None:
        """Do the work of one period: send a command of the motion, or check the stop.

        Raises:
            DataError: the commands no longer reach the drives, or a stop is not measured in time.
        """
        if not self._moves:
            if not self._ready(now):
                return
            self.get_logger().info(f"sets off: {self._positioning.doing}")
            self._set_off()
        trouble = self._driven.lasting_trouble()
        if trouble:
            raise DataError(f"stopped during {self._positioning.doing}: {trouble}")
        if self._motion:
            self._send(self._motion.pop(0))
            self._arrived = now
            return
        self._send(self._positioning.step)  # repeated at a stop: commands never cease
        if self._standing is None:
            if now - self._arrived >= self._settings.number("dwell"):
                self._standing = self._stop()
            return
        mean = self._standing.mean
        if mean is None:
            self._require_patience(now)
            return
        self._standing, self._last = None, mean
        self._positioning.tell(mean)
        self._say_progress()
        if self._positioning.done:
            self.finish()
        else:
            self._set_off()

    def _ready(self, now: float) -> bool:
        """Whether a subscriber is present and the position of the machine is known.

        Raises:
            DataError: this was not the case in time.
        """
        self._driven.forget()
        trouble, limit = self._driven.trouble(), self._settings.number("wait_for_subscriber")
        if trouble or self._here is None:
            self._found = None
            if now - self._created >= limit:
                states = (
                    "no joint_states were received" if self._here is None else "joint_states came"
                )
                why = ", ".join(filter(None, [trouble, states]))
                raise DataError(
                    f"did not begin within {limit:g} s: {why}; commands reach the drives through "
                    "calibration_node: are it and the machine (or simulated_tracker) running?"
                )
            return False
        self._found = now if self._found is None else self._found
        return now - self._found >= SETTLE_S

    def _set_off(self) -> None:
        """Plan the motion to the next stop, which is always approached from the same side."""
        step, here = self._positioning.step, self._here
        if here is None:
            return
        stop = Plan(NAME, np.zeros((1, 3)), step[None], np.ones(1), np.zeros(1), dwell=0.0)
        (leg,) = legs(stop, self._robot, self._settings.number("rate"), here)
        if np.array_equal(step, here):
            self._last = None  # same stop again: an equal reading is no error
        self._motion, self._here = list(leg.joint), step
        self._moves += 1

    def _stop(self) -> StopDetector:
        joints = self._robot.joints
        return StopDetector(
            joints.names,
            self._positioning.step,
            max(self._unit / 2.0, ENCODER_SIGMAS * joints.encoder),
            self._settings.integer("readings"),
            self._robot.tracker,
            self._last,
            joints.unit,
        )

    def _send(self, joint: Array) -> None:
        stamp = self.get_clock().now().to_msg()
        self._commands.publish(joint_state(self._robot.joints.names, joint, stamp))

    def _require_patience(self, now: float) -> None:
        limit = self._settings.number("patience")
        if self._standing is not None and now - self._arrived >= limit:
            raise DataError(
                f"{self._positioning.doing}: not measured in {limit:g} s: {self._standing.trouble}"
            )

    # --- what is told

    def _say_progress(self) -> None:
        """Log the frame once, and each finished target; write the table with each target."""
        doing, frame = self._positioning, self._positioning.frame
        if frame is not None and self._moves == frame.stops:
            self.get_logger().info(str(frame))
        outcomes = doing.outcomes
        if len(outcomes) > self._said:
            self._said = len(outcomes)
            output = Path(self._settings.named("output"))
            write_outcomes(output, self._robot.joints.names, outcomes)
            self._say_outcome(outcomes[-1])

    def _say_outcome(self, outcome: Outcome) -> None:
        text = (
            f"point {self._said}: {outcome.before * 1e3:.4f} mm before, "
            f"{outcome.after * 1e3:.4f} mm after, {outcome.moves} moves"
        )
        if outcome.stop is not Stop.FINEST:
            self.get_logger().warn(f"{text}: {outcome.stop.value}")
        elif outcome.after > outcome.before:
            self.get_logger().warn(
                f"{text}: not improved; the error was already within the measurement uncertainty"
            )
        else:
            self.get_logger().info(text)

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        positioning = self._positioning
        values: dict[str, object] = {"moves": self._moves}
        values["points done"] = len(positioning.outcomes)
        if self._stopped:
            return DiagnosticStatus.ERROR, self._stopped, values
        if not self._moves:
            return DiagnosticStatus.OK, "waiting for a subscriber", values
        if positioning.done:
            return DiagnosticStatus.OK, "done", values
        if self._standing is not None:
            values["waits for"] = self._standing.trouble
        return DiagnosticStatus.OK, positioning.doing, values


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until all points are done, or until it is stopped; returns the exit code."""
    build: Callable[[], GridPositioner] = GridPositioner
    return run(build, NAME, arguments)


if __name__ == "__main__":
    leave(run_node(NAME))
