"""The cell around the node in a soak: commands, listens, calls services, starts and stops it."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from array import array
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from delta_calibration.robot import Robot
from node_processes import Processes, given, motion
from soak_faults import NEAR, Faults, Steps
from soak_outputs import Outputs, Told

NODE = "delta_calibration.ros.calibration_node"
RAMP_S = 0.2
TIMEOUT_S = 0.5  # [s] age of a command
OFFSET_SPEED = 1.0  # [rad/s] speed of moves to another part of the workspace
PAGE = os.sysconf("SC_PAGE_SIZE") / 2**20  # [MB]
BEHIND = 30  # commands without an output: the node is behind or drops them
KEPT = 5000  # number of recent commands whose outputs may still come


class Cell:
    """Commands at 1 kHz and everything else that a node receives; the node is another process."""

    def __init__(
        self,
        running: Processes,
        robot: Robot,
        robot_file: Path,
        calibrations: dict[str, Path],
        outputs: Outputs,
        faults: Faults,
        seconds: float,
        rate: float,
        hz: float,
    ) -> None:
        self.running, self.robot, self.outputs, self.faults = running, robot, outputs, faults
        self.seconds, self.rate, self.hz = seconds, rate, hz
        self.middle = robot.model().home
        self._arguments = given(
            robot=robot_file,
            autostart=True,
            calibration=calibrations["plain"],
            data_dir=calibrations["plain"].parent,  # folder from which others may be loaded
            command_controller="forward",
            tracker_timeout_s=1.0,
            **self.parameters(),
        )
        self.spoil: float | None = None
        self.tracked = self.warm = self.sending = True
        self.echoing = self.holding = False
        self.shift, self.mark, self.amplitude = 0.0, "", 1.0
        self._goal = self._offset = NEAR
        self._ticked = time.monotonic()
        self.commanded = self.left_out = self.rounds = self._ticks = 0
        self._unanswered = 0  # commands since the last output
        self._correction = NEAR  # last one that was observed
        self.counts: Counter[str] = Counter()  # summed over all starts of the node
        self._life: dict[str, int] = {}
        self.told = {"tracker silent": False}
        self.memory: list[tuple[float, float]] = []  # [s], [MB], since the last start of the node
        self._last_out = self.middle

    def parameters(self) -> dict[str, Any]:
        """Parameters with which the node starts, and to which it returns after a storm."""
        return {
            "ramp_s": RAMP_S,
            "max_correction_rate": self.rate,
            "command_timeout_s": TIMEOUT_S,
            "on_failure": "pass_through",
        }

    # --- the run

    def run(self) -> None:
        """Take the node through its rounds until the time is over and one round is complete."""
        import rclpy
        from rclpy.clock import Clock
        from rclpy.clock_type import ClockType
        from rclpy.node import Node
        from rclpy.task import Future

        from delta_calibration.ros.runtime import make_executor

        rclpy.init(args=[])
        self.node = Node("soak")
        self._connect()
        self._steps = self._scenario()
        self._going = True
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(1.0 / self.hz, self._tick, clock=steady)
        executor = make_executor()
        executor.add_node(self.node)
        while self._going:
            executor.spin_until_future_complete(Future(), 0.2)
        executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _scenario(self) -> Steps:
        begin = self._begin = time.monotonic()
        self._start()
        yield from self._ready()
        while time.monotonic() - begin < self.seconds or not self.rounds:
            if time.monotonic() - begin < self.seconds / 2:
                yield from self._restart(signal.SIGKILL)
                yield from self._restart(signal.SIGINT)
            for _ in self.faults.round(self):
                if self.rounds and time.monotonic() - begin > self.seconds:
                    break
                yield
            else:
                self.rounds += 1
        yield from self.wait(2.5)  # for the last diagnostics

    def _tick(self) -> None:
        if not self._going:
            return
        try:
            next(self._steps)
        except StopIteration:
            self._going = False
            return
        self._ticks += 1
        now = time.monotonic()
        step, self._ticked = OFFSET_SPEED * (now - self._ticked), now
        self._offset = self._offset + np.clip(self._goal - self._offset, -step, step)
        if self.sending and (self._unanswered < BEHIND or self._ticks % 10 == 0):
            self.command(self.shift)
        elif self.sending:
            self.left_out += 1
        if self._ticks % 10 == 0:
            self._surroundings()
        if self._ticks % 500 == 0 and self._child.poll() is None:
            pages = Path(f"/proc/{self._child.pid}/statm").read_text().split()[1]
            self.memory.append((time.monotonic(), int(pages) * PAGE))

    def go(self, goal: np.ndarray) -> Steps:
        """Move the joints to `goal` (3,) [rad] relative to the middle, and stay there a moment."""
        self._goal = goal
        while (self._offset != goal).any():
            yield
        yield from self.wait(0.3)

    def wait(self, seconds: float) -> Steps:
        """Continue for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            yield

    # --- topics

    def _connect(self) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import PointStamped
        from lifecycle_msgs.srv import ChangeState
        from rcl_interfaces.srv import SetParameters
        from sensor_msgs.msg import JointState, Temperature
        from std_srvs.srv import SetBool, Trigger

        from delta_calibration.ros.qos import COMMAND, DIAGNOSTICS, STREAM_OUT

        node, own = self.node, "/calibration_node"
        self._command = node.create_publisher(JointState, "joint_command", STREAM_OUT)
        self._states = node.create_publisher(JointState, "joint_states", STREAM_OUT)
        self._point = node.create_publisher(PointStamped, "tracker/point", STREAM_OUT)
        self._warm = node.create_publisher(Temperature, "cell/temperature", STREAM_OUT)
        out = "joint_command_compensated"
        node.create_subscription(JointState, out, self._on_output, COMMAND)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_told, DIAGNOSTICS)
        self._services = {
            name: node.create_client(Trigger, f"{own}/{name}")
            for name in ("reload", "start_capture", "stop_capture")
        }
        self._services["enable"] = node.create_client(SetBool, f"{own}/enable")
        self._setter = node.create_client(SetParameters, f"{own}/set_parameters")
        self._changer = node.create_client(ChangeState, f"{own}/change_state")

    def command(self, shift: float) -> None:
        """Publish a command, with its stamp shifted by some seconds."""
        from sensor_msgs.msg import JointState

        from delta_calibration.ros.conversions import ns_to_stamp

        now = time.monotonic()
        q = self.middle + self.amplitude * (motion(NEAR, now)) + self._offset
        if self.mark:  # as if a node upstream had compensated
            q = q + self._correction
        if self.echoing:
            q = self._last_out.copy()
        if self.spoil is not None:
            q[self._ticks % 3] = self.spoil
        stamp = time.time_ns() + int(shift * 1e9)
        message = JointState(name=list(self.robot.joints.names), position=array("d", q))
        message.header.stamp, message.header.frame_id = ns_to_stamp(stamp), self.mark
        told = self.outputs.told
        told[stamp] = Told(now, q, self.holding)
        if len(told) > KEPT:
            del told[next(iter(told))]
        self.commanded += 1
        self._unanswered += 1
        self._command.publish(message)

    def _surroundings(self) -> None:
        from geometry_msgs.msg import PointStamped
        from sensor_msgs.msg import JointState, Temperature

        stamp = self.node.get_clock().now().to_msg()
        names = list(self.robot.joints.names)
        states = JointState(name=names, position=array("d", self._last_out))
        states.header.stamp = stamp
        self._states.publish(states)
        if self.tracked:
            point = PointStamped()
            point.header.stamp = stamp
            point.point.x, point.point.y, point.point.z = 1.0, 2.0, 0.5
            self._point.publish(point)
        if self.warm and self._ticks % 200 == 0:
            arm = Temperature(temperature=24.0)
            arm.header.frame_id, arm.header.stamp = "arm", stamp
            self._warm.publish(arm)

    def _on_output(self, message: Any) -> None:
        from delta_calibration.ros.conversions import stamp_to_ns

        now, out = time.monotonic(), np.array(message.position)
        stamp = stamp_to_ns(message.header.stamp)
        self._unanswered = 0
        self.outputs.take(stamp, out, now)
        if np.isfinite(out).all():
            self._last_out = out
            told = self.outputs.told.get(stamp)
            if told is not None and not self.mark and not self.echoing:
                gap = out - told.joint
                if np.isfinite(gap).all() and np.abs(gap).max() < self.outputs.bound:
                    self._correction = gap

    def _on_told(self, message: Any) -> None:
        for status in message.status:
            for text in self.told:
                self.told[text] = self.told[text] or text in status.message
            for pair in status.values:
                name = pair.key.removeprefix("command ")
                if name != pair.key and pair.value.isdigit():
                    grown = int(pair.value) - self._life.get(name, 0)
                    self._life[name] = int(pair.value)
                    self.counts[name] += max(grown, 0)

    # --- services

    def order(self, name: str, value: bool | None = None) -> Any:
        """Call a service; return whether it succeeded."""
        from std_srvs.srv import SetBool, Trigger

        request = Trigger.Request() if value is None else SetBool.Request(data=value)
        answer = yield from self._ask(self._services[name], request)
        return bool(answer.success)

    def load(self, file: Path) -> Any:
        """Make the node load a calibration; return whether it did."""
        yield from self.set(calibration=str(file))
        return (yield from self.order("reload"))

    def set(self, **values: Any) -> Any:
        """Set parameters; return whether all were accepted."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        answer = yield from self._ask(self._setter, SetParameters.Request(parameters=parameters))
        return all(result.successful for result in answer.results)

    def transit(self, transition: int) -> Any:
        """Request a lifecycle transition, valid or not."""
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState

        request = ChangeState.Request(transition=Transition(id=transition))
        yield from self._ask(self._changer, request)

    def _ask(self, client: Any, request: Any) -> Any:
        yield from self._until(client.service_is_ready, "a service")
        answer = client.call_async(request)
        yield from self._until(answer.done, f"an answer of {client.srv_name}")
        return answer.result()

    def _until(self, condition: Callable[[], Any], what: str) -> Steps:
        end = time.monotonic() + 60.0
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError(f"no {what} within 60 s; see {self.running.logs}")
            yield

    # --- the node

    def _start(self) -> None:
        self._child: subprocess.Popen[bytes]
        self._child = self.running.start("calibration_node", NODE, self._arguments)
        self._life, self.memory = {}, []
        self.holding = True  # it starts at the position of the drives and moves to the commands
        self.outputs.forget()

    def _ready(self) -> Steps:
        """Wait until it sends outputs and follows the commands; switch compensation on."""
        before = self.outputs.count
        yield from self._until(lambda: self.outputs.count > before, "output")
        yield from self.wait(RAMP_S + 1.0)
        self.holding = False
        yield from self.order("enable", True)
        yield from self.wait(0.5)

    def _restart(self, number: signal.Signals) -> Steps:
        yield from self.wait(1.2)  # its counters are published once a second
        self._child.send_signal(number)
        yield from self._until(lambda: self._child.poll() is not None, "end of the node")
        if number == signal.SIGINT and self._child.returncode != 0:
            self.outputs.broken.append(f"the node ended with {self._child.returncode}")
        self.outputs.told.clear()
        self._start()
        yield from self._ready()
