"""Lifecycle node on the way of the joint commands: compensates them, and calibrates the cell."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from delta_calibration.cell.background import Background
from delta_calibration.cell.command_path import Sent
from delta_calibration.cell.desk import Desk
from delta_calibration.cell.fitting import Fitted, diagnosed, fit
from delta_calibration.cell.health import Health, Level
from delta_calibration.compensation import JointCompensator
from delta_calibration.errors import CalibrationError, DataError
from delta_calibration.ros import conversions
from delta_calibration.ros.calibration_parameters import SPECS, desk_settings
from delta_calibration.ros.conversions import JointReader, joint_state, stamp_to_ns
from delta_calibration.ros.deferred import Deferred, allow_deferred
from delta_calibration.ros.diagnostics import Diagnostics, status
from delta_calibration.ros.lifecycle import SafeLifecycleNode
from delta_calibration.ros.parameters import ParameterTable, warn_of_unknown
from delta_calibration.ros.qos import INPUTS, STATUS, STREAM_OUT
from delta_calibration.ros.runtime import run

NAME = "calibration_node"
MARK = "compensated"  # header.frame_id of a command that has been compensated
POLL_S = 0.05  # [s] until the end of a fit is noticed
WARN_EVERY_S = 5.0  # [s]
LEVELS = {
    Level.OK: DiagnosticStatus.OK,
    Level.WARN: DiagnosticStatus.WARN,
    Level.ERROR: DiagnosticStatus.ERROR,
}


class CalibrationNode(SafeLifecycleNode):
    """Wires topics and services to a `Desk`; the command path runs on while a fit does."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        self._settings = ParameterTable(self, SPECS, self._on_change)
        warn_of_unknown(self)
        self._desk: Desk | None = None
        self._active = False
        self._listening: list[Any] = []
        self._told: tuple[bytes, str] | None = None
        self._job: Background[tuple[Fitted, JointCompensator]] | None = None
        self._waiting = Deferred()
        self._out = self.create_lifecycle_publisher(
            JointState, "joint_command_compensated", STREAM_OUT
        )
        self._nominal = self.create_lifecycle_publisher(
            JointState, "joint_states_nominal", STREAM_OUT
        )
        self._status = self.create_publisher(DiagnosticStatus, "~/status", STATUS)
        self._serve()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._poll = self.create_timer(POLL_S, self._finish_fit, clock=steady)
        self._poll.cancel()
        self._diagnostics = Diagnostics(self, self._report)

    def _serve(self) -> None:
        orders: dict[str, Callable[[Desk], str]] = {
            "start_capture": self._start_capture,
            "stop_capture": Desk.stop_capture,
            "save": lambda desk: desk.save(self._settings.text("output")),
            "reload": lambda desk: desk.reload(self._settings.text("calibration")),
        }
        for name, order in orders.items():
            self.create_service(Trigger, f"~/{name}", partial(self._obey, order))
        self.create_service(SetBool, "~/enable", self._on_enable)
        for name, way in (("fit", fit), ("diagnose", diagnosed)):
            service = self.create_service(Trigger, f"~/{name}", partial(self._on_fit, way))
            allow_deferred(service)

    # --- lifecycle

    def configure(self) -> None:
        """Load robot and calibration, and listen."""
        desk = Desk(desk_settings(self._settings))
        self._command_reader = JointReader(desk.robot.joints.names)
        self._states_reader = JointReader(desk.robot.joints.names)
        self._desk = desk
        self._listen()
        self.get_logger().info(f"configured for {desk.robot.name}")
        if desk.left_out:
            self.get_logger().warn(desk.left_out)

    def _listen(self) -> None:
        take: dict[str, Callable[[Desk, Any], None]] = {
            "joint_command": self._on_command,
            "joint_states": self._on_states,
            "tracker/pose": self._on_pose,
            "tracker/point": self._on_point,
            "cell/temperature": self._on_temperature,
            "cell/payload": self._on_payload,
        }
        for topic in INPUTS:
            receive = partial(self._receive, topic.name, take[topic.name])
            subscription = self.create_subscription(
                topic.message, topic.name, receive, topic.reader
            )
            self._listening.append(subscription)

    def activate(self) -> None:
        """Begin to send, uncompensated."""
        if self._desk is not None:
            self._desk.reset()
        self._active = True

    def deactivate(self) -> None:
        """Send nothing any more."""
        self._active = False
        if self._desk is not None and self._desk.capture.running:
            self.get_logger().warn(f"deactivated: {self._desk.stop_capture()}")

    def cleanup(self) -> None:
        """Let go of everything; a fit that runs is not waited for."""
        self._active = False
        while self._listening:
            self.destroy_subscription(self._listening.pop())
        self._desk, self._job = None, None
        self._poll.cancel()
        self._waiting.answer(_no("the node was cleaned up during the fit"))

    # --- topics

    def _receive(self, topic: str, take: Callable[[Desk, Any], None], message: Any) -> None:
        """Hand a message on; one that is of no use is counted and told."""
        # The payload is said once, a temperature seldom: known before the node is active.
        if self._desk is None or not (self._active or topic.startswith("cell/")):
            return
        try:
            take(self._desk, message)
        except CalibrationError as error:
            self._desk.watch.refuse(topic, str(error), time.monotonic())
            self._warn(f"{topic}: refused: {error}")

    def _on_command(self, desk: Desk, message: JointState) -> None:
        now_s, stamp_ns = time.monotonic(), stamp_to_ns(message.header.stamp)
        try:
            q = self._command_reader.positions(message)
        except CalibrationError as error:
            self._send(desk, message, desk.path.refuse(str(error)))
            raise
        already = message.header.frame_id == MARK
        sent = desk.send(q, stamp_ns, now_s, already)
        if already:
            self._out.publish(message)
        else:
            desk.capture.add_command(stamp_ns, q)
            self._send(desk, message, sent)
        desk.watch.took(time.monotonic() - now_s, stamp_ns, now_s)
        if desk.path.trouble is not None:
            desk.watch.trouble("joint_command", desk.path.trouble, now_s)
            self._warn(f"joint_command: {desk.path.trouble}")

    def _send(self, desk: Desk, message: JointState, sent: Sent | None) -> None:
        if sent is not None:
            out = joint_state(desk.robot.joints.names, sent.joint, message.header.stamp)
            out.header.frame_id = MARK if sent.compensated else ""
            self._out.publish(out)

    def _on_states(self, desk: Desk, message: JointState) -> None:
        q = self._states_reader.positions(message)
        desk.watch.heard("joint_states", time.monotonic())
        desk.capture.add_states(stamp_to_ns(message.header.stamp), q)
        names = desk.robot.joints.names
        self._nominal.publish(joint_state(names, desk.path.nominal(q), message.header.stamp))

    def _on_pose(self, desk: Desk, message: Any) -> None:
        reflector = desk.robot.tracker.measures == "position"
        self._take_reading(desk, conversions.tracker_pose(message, position_only=reflector))

    def _on_point(self, desk: Desk, message: Any) -> None:
        self._take_reading(desk, conversions.tracker_point(message))

    def _take_reading(self, desk: Desk, reading: conversions.TrackerReading) -> None:
        desk.watch.heard("tracker", time.monotonic())
        desk.capture.add_tracker(reading.stamp_ns, reading.position, reading.quaternion)

    def _on_temperature(self, desk: Desk, message: Any) -> None:
        desk.is_warm(*conversions.temperature(message), time.monotonic())

    def _on_payload(self, desk: Desk, message: Any) -> None:
        desk.carries(*conversions.payload(message), time.monotonic())

    # --- services

    def _obey(self, order: Callable[[Desk], str], _request: Any, response: Any) -> Any:
        """Answer with the desk's sentence, or with false and the reason."""
        try:
            response.message, response.success = order(self._require_desk()), True
        except CalibrationError as error:
            response.message, response.success = str(error), False
        self._log_answer(response)
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        return self._obey(lambda desk: desk.enable(bool(request.data)), request, response)

    def _start_capture(self, desk: Desk) -> str:
        if not self._active:
            raise DataError(f"the node is {self.state}; activate it first")
        return desk.start_capture(time.monotonic())

    def _require_desk(self) -> Desk:
        if self._desk is None:
            raise DataError(f"the node is {self.state}; configure it first")
        return self._desk

    def _on_fit(self, way: Callable[..., Fitted], _request: Any, response: Any) -> Any:
        try:
            if self._job is not None:
                raise DataError("a fit is running already")
            self._job = Background(self._require_desk().prepare_fit(way))
        except CalibrationError as error:
            response.message, response.success = str(error), False
            self._log_answer(response)
            return response
        self._poll.reset()
        self._waiting = Deferred()
        return self._waiting

    def _finish_fit(self) -> None:
        if self._job is None or not self._job.done or self._desk is None:
            return
        job, self._job = self._job, None
        self._poll.cancel()
        try:
            answer = Trigger.Response(success=True, message=self._desk.take(*job.result()))
        except CalibrationError as error:
            answer = _no(str(error))
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            answer = _no(f"the fit failed: {error!r}")
        self._log_answer(answer)
        self._waiting.answer(answer)

    def _log_answer(self, response: Any) -> None:
        log = self.get_logger()
        if response.success:
            log.info(response.message)
        else:
            log.warn(response.message)

    # --- what is told

    def _warn(self, text: str) -> None:
        self.get_logger().warn(text, throttle_duration_sec=WARN_EVERY_S)

    def _on_change(self, _names: tuple[str, ...]) -> None:
        if self._desk is not None:
            number, on_failure = self._settings.number, self._settings.text("on_failure")
            rate = number("max_correction_rate")
            self._desk.path.set_options(on_failure, number("ramp_s"), rate)
            timeouts = number("temperature_timeout_s"), number("payload_timeout_s")
            self._desk.around.set_timeouts(*timeouts)

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        health = self._health()
        level, name = LEVELS[health.level], self.get_fully_qualified_name()
        if self._told != (level, health.message):
            self._told = level, health.message
            self._status.publish(status(level, name, health.message, health.values))
        return level, health.message, health.values

    def _health(self) -> Health:
        if self._desk is None:
            return Health(Level.WARN, f"{self.state}: nothing is sent", {})
        timeout_s = self._settings.number("tracker_timeout_s")
        health = self._desk.health(time.monotonic(), timeout_s)
        if not self._active:
            return replace(health, message=f"{self.state}: nothing is sent")
        return health


def _no(reason: str) -> Trigger.Response:
    return Trigger.Response(success=False, message=reason)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    build: Callable[[], CalibrationNode] = CalibrationNode
    return run(build, NAME, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
