"""Lifecycle node that compensates joint commands for the drives and calibrates the cell."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from delta_calibration.cell.backlog import WAIT_S
from delta_calibration.cell.calibration_session import CalibrationSession
from delta_calibration.cell.command_path import Sent
from delta_calibration.cell.fitting import (
    DIAGNOSIS_STEPS,
    FIT_STEPS,
    FittedCalibration,
    diagnosed,
    fit,
)
from delta_calibration.cell.health import Health, Level
from delta_calibration.cell.joint_bytes import Bytes
from delta_calibration.cell.task import Task
from delta_calibration.cell.usual import MARK
from delta_calibration.description import frame_prefix
from delta_calibration.errors import CalibrationError, DataError, InputError
from delta_calibration.ros import conversions
from delta_calibration.ros.calibration_parameters import SPECS, desk_settings, topic_named
from delta_calibration.ros.controllers import Controllers
from delta_calibration.ros.diagnostics import Diagnostics, status
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.jobs import Finish, Jobs, Work
from delta_calibration.ros.joint_intake import JointIntake, Stamp, nanoseconds
from delta_calibration.ros.lifecycle import SafeLifecycleNode
from delta_calibration.ros.markers import Markers
from delta_calibration.ros.own_process import OwnProcess
from delta_calibration.ros.parameters import ParameterTable, warn_of_unknown
from delta_calibration.ros.progress import Doing, Progress
from delta_calibration.ros.qos import CONTROLLER, INPUTS, STATUS, STREAM_OUT
from delta_calibration.ros.runtime import run
from delta_calibration.ros.throttle import Throttle
from delta_calibration.ros.trajectories import Trajectories
from delta_calibration.ros.watchdog import leave
from delta_calibration.texts import bounded

Array = NDArray[np.float64]

NAME = "calibration_node"
RAW = ("joint_command", "joint_states")  # received as serialized bytes
EARLY = ("joint_states", "cell/temperature", "cell/payload")  # taken before the node is active
WARN_EVERY_S = 5.0  # [s]
SWITCH_S = 5e-4  # [s] thread switch interval: a fit or file read yields to commands within it
LEVELS = {
    Level.OK: DiagnosticStatus.OK,
    Level.WARN: DiagnosticStatus.WARN,
    Level.ERROR: DiagnosticStatus.ERROR,
}
WAYS = (("fit", fit, FIT_STEPS), ("diagnose", diagnosed, DIAGNOSIS_STEPS))


class CalibrationNode(SafeLifecycleNode):
    """Wires topics and services to a `CalibrationSession`; commands are processed during a fit.

    Args:
        alone: whether the node has its own process, which is then tuned for commands at 1 kHz.
        kwargs: arguments of a node.
    """

    def __init__(self, alone: bool = False, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        self._process, self._warnings = OwnProcess(alone), Throttle(WARN_EVERY_S)
        self._settings = ParameterTable(self, SPECS, self._on_change)
        warn_of_unknown(self)
        self._desk: CalibrationSession | None = None
        self._active = False
        self._refused = ""  # why the node could not be configured
        self._listening: list[Any] = []
        self._told: tuple[bytes, str] | None = None
        self._controllers: Controllers | None = None
        self._out = self.create_lifecycle_publisher(
            JointState, "joint_command_compensated", STREAM_OUT
        )
        self._nominal = self.create_lifecycle_publisher(
            JointState, "joint_states_nominal", STREAM_OUT
        )
        self._status = self.create_publisher(DiagnosticStatus, "~/status", STATUS)
        self._task: Task | None = None  # the last fit or diagnosis started
        self._progress = Progress(self, self._doing)
        self._jobs = Jobs(self, self._tell_of, self._progress.publish)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._release = self.create_timer(WAIT_S, self._on_release, clock=steady)
        self._release.cancel()
        self._trajectories = Trajectories(
            self, MARK, self._send_all, self._warn_of_trajectory, self._refuse_trajectory
        )
        self._serve()
        self._diagnostics = Diagnostics(self, self._report)
        scale = partial(self._settings.number, "error_scale")
        prefix = frame_prefix(self._settings.text("frame_prefix"))
        self._markers = Markers(self, lambda: self._desk, scale, prefix)
        self.shut_to_peers()

    def _serve(self) -> None:
        orders: dict[str, Callable[[CalibrationSession], str]] = {
            "start_capture": self._start_capture,
            "stop_capture": CalibrationSession.stop_capture,
        }
        for name, order in orders.items():
            self.create_service(Trigger, f"~/{name}", partial(self._obey, order))
        self.create_service(SetBool, "~/enable", self._on_enable)
        for name, way, steps in WAYS:
            self._jobs.serve(name, "fit", partial(self._prepare_fit, name, way, steps))
        self._jobs.serve("save", "save", self._prepare_save)
        self._jobs.serve("reload", "reload", self._prepare_reload)

    # --- lifecycle

    def configure(self) -> None:
        """Load robot and calibration, and subscribe; a refusal remains visible on diagnostics."""
        try:
            self._configure()
        except CalibrationError as error:
            self._refused = str(error)
            raise
        self._refused = ""

    def _configure(self) -> None:
        self._require_apart()
        desk = CalibrationSession(desk_settings(self._settings), self._follow)
        topic, joints = partial(topic_named, self._settings), desk.robot.joints
        trajectories, trajectory_input = topic("trajectory_controller"), topic("trajectory_input")
        if trajectory_input and not trajectories:
            raise InputError(
                "parameter trajectory_input: needs a trajectory_controller to send to"
            )
        self._controllers = Controllers(
            self,
            joints.names,
            joints.passed_through,
            topic("command_controller"),
            self._settings.texts("command_joints"),
            trajectories,
        )
        self._streams = not trajectory_input
        self._commands, self._states = (
            JointIntake(joints.names, joints.passed_through) for _ in range(2)
        )
        told = joints.names, joints.names + joints.passed_through
        self._written = {
            (mark, len(names)): Bytes(names, mark) for mark in ("", MARK) for names in told
        }
        self._desk = desk
        self._diagnostics.hardware = desk.robot.name
        self._listen()
        self.get_logger().info(f"configured for {desk.robot.name}")
        if desk.left_out:
            self.get_logger().warn(desk.left_out)

    def _require_apart(self) -> None:
        """Require that no output topic is an input topic: the node would hear its own output."""
        for heard, publisher in (("joint_command", self._out), ("joint_states", self._nominal)):
            if self.resolve_topic_name(heard) == publisher.topic_name:
                raise InputError(f"{heard} is {publisher.topic_name}, which the node itself sends")

    def _listen(self) -> None:
        take: dict[str, Callable[[CalibrationSession, Any], None]] = {
            "joint_command": self._on_command,
            "joint_states": self._on_states,
            "tracker/pose": self._on_pose,
            "tracker/point": self._on_point,
            "cell/temperature": self._on_temperature,
            "cell/payload": self._on_payload,
        }
        for topic in INPUTS:
            receive = partial(self._receive, topic.name, take[topic.name])
            events = SubscriptionEventCallbacks(message_lost=partial(self._on_lost, topic.name))
            subscription = self.create_subscription(
                topic.message,
                topic.name,
                receive,
                topic.reader,
                event_callbacks=events,
                raw=topic.name in RAW,
            )
            self._listening.append(subscription)
        name = self._settings.text("trajectory_input")
        if name:
            take_all = partial(self._receive, name, self._trajectories.take)
            self._listening.append(
                self.create_subscription(JointTrajectory, name, take_all, CONTROLLER, raw=True)
            )

    def activate(self) -> None:
        """Start sending, uncompensated unless the parameter `enabled` is set."""
        if self._desk is not None:
            self._desk.reset()
            if self._settings.flag("enabled"):
                self._desk.enable(True)
        self._process.hold(self._settings.integer("realtime_priority"))
        self._active = True

    def deactivate(self) -> None:
        """Stop sending."""
        self._active = False
        if self._trajectories.drop():
            self.get_logger().warn("deactivated: the trajectory in progress is not sent")
        self._process.release()
        if self._desk is not None and self._desk.capture.running:
            self.get_logger().warn(f"deactivated: {self._desk.stop_capture()}")

    def cleanup(self) -> None:
        """Release everything; a running fit is not waited for."""
        self._active = False
        self._trajectories.drop()
        self._process.release()
        while self._listening:
            self.destroy_subscription(self._listening.pop())
        if self._controllers is not None:
            self._controllers.close()
        self._desk, self._controllers = None, None
        self._jobs.drop("the node was cleaned up")

    # --- topics

    def _receive(
        self, topic: str, take: Callable[[CalibrationSession, Any], None], message: Any
    ) -> None:
        """Pass a message to its handler; a refused one is counted and reported."""
        # A payload is sent once and temperatures seldom, so they are taken before the node is
        # active; the position of the drives has to be known when the first command arrives.
        if self._desk is None or not (self._active or topic in EARLY):
            return
        try:
            take(self._desk, message)
        except CalibrationError as error:
            self._desk.watch.refuse(topic, str(error), time.monotonic())
            self._warn(f"{topic}: refused: {error}")

    def _on_lost(self, topic: str, event: Any) -> None:
        """Count messages whose loss the middleware has reported."""
        if self._desk is not None and self._active:
            self._desk.watch.lose(topic, int(event.total_count_change), time.monotonic())

    def _on_command(self, desk: CalibrationSession, message: bytes) -> None:
        """Process a command; of those queued while the process was stopped, only the last."""
        stamp, now_s = self._commands.stamp(message), time.monotonic()
        due = desk.backlog.take((message, stamp), nanoseconds(stamp), now_s)
        if desk.backlog.waiting is not None:
            self._release.reset()
        for each in due:
            self._follow_command(desk, each)

    def _on_release(self) -> None:
        """Send the waiting command, as no newer one arrived."""
        self._release.cancel()
        if self._desk is not None and self._active:
            for each in self._desk.backlog.release():
                self._receive("joint_command", self._follow_command, each)

    def _follow_command(self, desk: CalibrationSession, given: tuple[bytes, Stamp]) -> None:
        """Send the output for a command first, then do all work that can wait."""
        (message, stamp), now_s = given, time.monotonic()
        if desk.backlog.interrupted:
            desk.path.interrupt()
            desk.watch.trouble("backlog", desk.backlog.trouble(), now_s)
            self._warn(f"joint_command: {desk.backlog.trouble()}")
            desk.backlog.interrupted = False
        age_s = self._age_s(desk, nanoseconds(stamp))
        out = desk.follow(message, now_s, age_s)
        if out is None:
            self._weigh(desk, message, stamp, age_s, now_s)
            return
        self._out.publish(out)
        q, stamp_ns, sent = desk.usual.went()
        self._control(desk, sent, MARK)
        self._sent(desk, q, stamp_ns, False, now_s)

    def _weigh(
        self, desk: CalibrationSession, message: bytes, stamp: Stamp, age_s: float, now_s: float
    ) -> None:
        """Send the output for a command that the fast path cannot handle."""
        try:
            given = self._commands.read(message)
        except CalibrationError as error:
            self._send(desk, stamp, desk.path.refuse(str(error)))
            raise
        if given.layout is not None:
            desk.usual.learn(given.layout, message)
        q, stamp_ns, already = given.position, nanoseconds(stamp), given.frame_id == MARK
        sent = desk.send(q, stamp_ns, now_s, already, age_s, desk.usual.seen)
        self._send(desk, stamp, sent)
        self._sent(desk, q, stamp_ns, already, now_s)
        if desk.path.trouble is not None:
            desk.watch.trouble("joint_command", desk.path.trouble, now_s)
            self._warn(f"joint_command: {desk.path.trouble}")

    def _sent(
        self, desk: CalibrationSession, q: Array, stamp_ns: int, already: bool, now_s: float
    ) -> None:
        """Record a processed command: capture, guard trail and processing time."""
        desk.keep(q, stamp_ns, already)
        self._markers.trail.see(q[: len(desk.robot.joints.names)], desk.path)
        desk.watch.took(time.monotonic() - now_s, stamp_ns, now_s)

    def _send(self, desk: CalibrationSession, stamp: Stamp, sent: Sent | None) -> None:
        if sent is not None:
            mark, whole = MARK if sent.compensated else "", sent.whole
            self._out.publish(self._written[mark, len(whole)].message(whole, stamp))
            self._control(desk, sent, mark)

    def _control(self, desk: CalibrationSession, sent: Sent, mark: str) -> None:
        """Send an output to the ros2_control controllers as well."""
        if self._controllers is None:
            return
        why = self._controllers.send(sent.whole, mark, self._streams)
        if why:
            desk.watch.trouble("command_controller", why, time.monotonic())
            self._warn(why)

    def _age_s(self, desk: CalibrationSession, stamp_ns: int) -> float:
        """Age of a command by the node's clock [s]; 0 without a timeout or without a stamp.

        NaN, with or without a stamp, while the clock does not run (simulated time, no `/clock`).
        """
        if desk.path.timeout_s == 0.0:
            return 0.0
        now_ns = self.get_clock().now().nanoseconds
        if not now_ns:
            return math.nan
        return float(now_ns - stamp_ns) * 1e-9 if stamp_ns else 0.0

    def _send_all(self, data: bytes) -> None:
        if self._controllers is not None and self._active:
            self._controllers.send_all(data)

    def _warn_of_trajectory(self, desk: CalibrationSession, why: str) -> None:
        desk.watch.trouble("trajectory", why, time.monotonic())
        self._warn(f"trajectory: {why}")

    def _refuse_trajectory(self, desk: CalibrationSession, why: str) -> None:
        name = self._settings.text("trajectory_input")
        desk.watch.refuse(name, why, time.monotonic())
        self._warn(f"{name}: refused: {why}")

    def _on_states(self, desk: CalibrationSession, message: bytes) -> None:
        given = self._states.read(message)
        q, now_s = given.position, time.monotonic()
        desk.watch.heard("joint_states", now_s)
        desk.stand(q, now_s)
        if not self._active:
            return
        nominal = desk.nominal(q, now_s)
        self._nominal.publish(self._written["", len(nominal)].message(nominal, given.stamp))
        desk.measured(q, nanoseconds(given.stamp))

    def _on_pose(self, desk: CalibrationSession, message: Any) -> None:
        reflector = desk.robot.tracker.measures == "position"
        self._take_reading(desk, conversions.tracker_pose(message, position_only=reflector))

    def _on_point(self, desk: CalibrationSession, message: Any) -> None:
        self._take_reading(desk, conversions.tracker_point(message))

    def _take_reading(self, desk: CalibrationSession, reading: conversions.TrackerReading) -> None:
        now_s = time.monotonic()
        desk.watch.heard("tracker", now_s)
        desk.read(reading.stamp_ns, reading.position, reading.quaternion, now_s)

    def _on_temperature(self, desk: CalibrationSession, message: Any) -> None:
        desk.is_warm(*conversions.temperature(message), time.monotonic())

    def _on_payload(self, desk: CalibrationSession, message: Any) -> None:
        desk.carries(*conversions.payload(message), time.monotonic())

    # --- services

    def _obey(
        self, order: Callable[[CalibrationSession], str], _request: Any, response: Any
    ) -> Any:
        """Respond with the session's sentence, or with false and the reason."""
        try:
            response.message, response.success = order(self._require_desk()), True
        except CalibrationError as error:
            response.message, response.success = str(error), False
        self._log_answer(response)
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        return self._obey(partial(self._enable, bool(request.data)), request, response)

    def _enable(self, on: bool, desk: CalibrationSession) -> str:
        if on:  # activation would switch it off again
            self._require_active()
        return desk.enable(on)

    def _start_capture(self, desk: CalibrationSession) -> str:
        self._require_active()
        return desk.start_capture(time.monotonic())

    def _require_active(self) -> None:
        if not self._active:
            raise DataError(f"the node is {self.state}; activate it first")

    def _require_desk(self) -> CalibrationSession:
        if self._desk is None:
            raise DataError(f"the node is {self.state}; configure it first")
        return self._desk

    def _prepare_fit(
        self, name: str, way: Callable[..., FittedCalibration], steps: Sequence[str]
    ) -> Work:
        desk, task = self._require_desk(), Task(name, steps, time.monotonic())
        work = desk.prepare_fit(way, task.begin)
        self._task = task
        return lambda: partial(desk.take, *work())

    def _prepare_save(self) -> Work:
        save = self._require_desk().prepare_save(self._file("output"))

        def work() -> Finish:
            sentence = save()
            return lambda: sentence

        return work

    def _file(self, name: str) -> str:
        """File named by a parameter; empty if it names none."""
        return str(self._settings.path(name) or "")

    def _prepare_reload(self) -> Work:
        desk, path = self._require_desk(), self._file("calibration")
        work = desk.prepare_reload(path, self._file("table"))
        return lambda: partial(desk.take_file, path, *work())

    def _tell_of(self, job: str, why: str) -> None:
        if self._desk is not None:
            self._desk.watch.trouble(job, why, time.monotonic())

    def _log_answer(self, response: Any) -> None:
        log = self.get_logger()
        if response.success:
            log.info(response.message)
        else:
            log.warn(response.message)

    # --- what is told

    def _warn(self, text: str) -> None:
        if self._warnings.lets():
            self.get_logger().warn(bounded(text))

    def _on_change(self, _names: tuple[str, ...]) -> None:
        if self._desk is not None:
            number, on_failure = self._settings.number, self._settings.text("on_failure")
            rate = number("max_correction_rate")
            timeout_s = number("command_timeout_s")
            beyond = self._settings.text("beyond_limits")
            self._desk.set_options(on_failure, number("ramp_s"), rate, timeout_s, beyond)
            timeouts = number("temperature_timeout_s"), number("payload_timeout_s")
            self._desk.around.set_timeouts(*timeouts)

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        self._process.tidy()
        health = self._health()
        level, name = LEVELS[health.level], self.get_fully_qualified_name()
        if self._told != (level, health.message):
            self._told = level, health.message
            hardware = self._diagnostics.hardware
            self._status.publish(status(level, name, health.message, health.values, hardware))
        return level, health.message, health.values

    def _follow(self, blocks: range) -> Iterator[int]:
        """Log the progress of computing the correction table, once a second."""
        for block in blocks:
            self.get_logger().info(
                f"table of corrections: {100 * block // len(blocks)} %", throttle_duration_sec=1.0
            )
            yield block

    def _doing(self) -> Doing:
        """Tasks that run beside the command path, for `~/progress`."""
        desk, task = self._desk, self._task
        doing: dict[str, tuple[str, Mapping[str, object]]] = {}
        if desk is not None and desk.capture.running:
            doing["capture"] = desk.captured(time.monotonic())
        if task is not None and "fit" in self._jobs.running:
            doing[task.name] = task.sentence(), task.values(time.monotonic())
        return doing

    def _look_for_others(self, desk: CalibrationSession) -> None:
        """Warn if another node also sends commands to the drives, which follow each in turn."""
        senders = self.count_publishers(self._out.topic_name)
        if self._active and senders > 1:
            told = f"{senders} nodes publish it; the drives follow all of them alternately"
            desk.watch.trouble(self._out.topic_name, told, time.monotonic())

    def _health(self) -> Health:
        if self._desk is None and self._refused:
            return Health(Level.ERROR, f"{self.state}, nothing is sent: {self._refused}", {})
        if self._desk is None:
            return Health(Level.WARN, f"{self.state}: nothing is sent", {})
        self._look_for_others(self._desk)
        now_s, timeout_s = time.monotonic(), self._settings.number("tracker_timeout_s")
        if self._process.refused:
            self._desk.watch.trouble("realtime_priority", self._process.refused, now_s)
        self._desk.watchman.look(now_s)
        health = self._desk.health(now_s, timeout_s)
        health = replace(health, values={**health.values, **self._process.values})
        if not self._active:
            return replace(health, message=f"{self.state}: nothing is sent")
        return health


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    sys.setswitchinterval(SWITCH_S)
    return run(partial(CalibrationNode, alone=True), NAME, arguments)


if __name__ == "__main__":
    leave(run_node(NAME))
