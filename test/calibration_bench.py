"""The calibration node with an upstream node, drives and an operator, in this process."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.ros.calibration_node import CalibrationNode
from delta_calibration.ros.conversions import joint_state, ns_to_stamp
from delta_calibration.ros.qos import DIAGNOSTICS, MEASURED, STATUS, STREAM_OUT
from delta_calibration.simulation import draw_machine, simulate_session
from ros_helpers import Bench

ROBOT = load_robot("srbd")
NAMES = ROBOT.joints.names
MACHINE = draw_machine(ROBOT, 5)
T0_NS = 1_700_000_000_000_000_000
Q = make_plan("line", ROBOT, count=5).joint[4]
CLEARLY = 1e-5  # [rad] smaller than the correction at Q


@pytest.fixture(scope="module", name="session")
def session_fixture() -> Any:
    return simulate_session(MACHINE, make_plan("identify", ROBOT, count=15, dwell=0.4), 5)


@pytest.fixture(scope="module", name="desk")
def desk_fixture(session: Any) -> CalibrationSession:
    desk = CalibrationSession(Settings("srbd", model="rotary_delta"))
    desk.start_capture(0.0)
    for k, stamp in enumerate(session.states.stamp_ns.tolist()):
        desk.capture.add_states(stamp, session.states.position[k])
        desk.capture.add_tracker(stamp, session.tracker.position[k])
    desk.take(*desk.prepare_fit()())
    return desk


@pytest.fixture(name="file")
def file_fixture(desk: CalibrationSession, tmp_path: Path) -> Path:
    path = tmp_path / "calibration.yaml"
    desk.save(str(path))
    return path


class Cell:
    """The node under test, with an upstream node, drives and an operator."""

    def __init__(self, bench: Bench, start: bool = True, **parameters: object) -> None:
        given = [
            Parameter(k, value=str(v) if isinstance(v, Path) else v) for k, v in parameters.items()
        ]
        self.bench = bench
        self.node = bench.add(CalibrationNode(context=bench.context, parameter_overrides=given))
        world = self.world = bench.node("world")
        self.command = world.create_publisher(JointState, "joint_command", STREAM_OUT)
        self.states = world.create_publisher(JointState, "joint_states", STREAM_OUT)
        self.tracker = world.create_publisher(PointStamped, "tracker/point", STREAM_OUT)
        self.sent: list[JointState] = []
        self.nominal: list[JointState] = []
        self.status: list[DiagnosticStatus] = []
        self.latched: list[DiagnosticStatus] = []
        name = "joint_command_compensated"
        self.sub = world.create_subscription(JointState, name, self.sent.append, 100)
        nominal = "joint_states_nominal"
        world.create_subscription(JointState, nominal, self.nominal.append, MEASURED)
        world.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.status.extend(m.status), DIAGNOSTICS
        )
        world.create_subscription(
            DiagnosticStatus, "/calibration_node/status", self.latched.append, STATUS
        )
        if start:
            self.node.trigger_configure()
            self.node.trigger_activate()
            self.found()

    def found(self) -> None:
        publishers = (self.command, self.states, self.tracker)
        assert self.bench.until(lambda: all(p.get_subscription_count() for p in publishers))
        assert self.bench.until(lambda: self.world.count_publishers("joint_command_compensated"))
        self.bench.spin_for(0.3)

    def give(self, q: np.ndarray, stamp_ns: int = T0_NS, frame: str = "") -> JointState | None:
        """Send a command; return the output for it, None if there is none."""
        message = JointState(name=list(NAMES), position=array("d", q.tolist()))
        message.header.stamp, message.header.frame_id = ns_to_stamp(stamp_ns), frame
        return self.answer(message)

    def answer(self, message: JointState) -> JointState | None:
        before = len(self.sent)
        self.command.publish(message)
        self.bench.until(lambda: len(self.sent) > before, 1.5)
        assert len(self.sent) <= before + 1
        return self.sent[-1] if len(self.sent) > before else None

    def call(self, name: str, value: bool | None = None) -> tuple[bool, str]:
        answer = self.ask(name, value)
        assert self.bench.until(answer.done)
        return answer.result().success, answer.result().message

    def ask(self, name: str, value: bool | None = None) -> Any:
        kind, request = Trigger, Trigger.Request()
        if value is not None:
            kind, request = SetBool, SetBool.Request(data=value)
        client = self.world.create_client(kind, f"/calibration_node/{name}")
        assert self.bench.until(client.service_is_ready)
        return client.call_async(request)

    def diagnosed(self, text: str, level: bytes = DiagnosticStatus.WARN) -> bool:
        self.status.clear()
        return self.bench.until(
            lambda: any(text in s.message and s.level == level for s in self.status), 4.0
        )

    def value(self, key: str) -> str:
        self.status.clear()
        assert self.bench.until(lambda: self.status)
        return {v.key: v.value for v in self.status[-1].values}[key]

    def measure(self, session: Any) -> None:
        for k, stamp in enumerate(session.states.stamp_ns.tolist()):
            self.states.publish(joint_state(NAMES, session.states.position[k], ns_to_stamp(stamp)))
            point = PointStamped()
            point.header.stamp = ns_to_stamp(stamp)
            point.point.x, point.point.y, point.point.z = session.tracker.position[k].tolist()
            self.tracker.publish(point)
            self.bench.until(lambda k=k: len(self.nominal) > k, 0.2)  # faster than a cell, no loss


def positions(message: JointState) -> np.ndarray:
    assert list(message.name) == list(NAMES)
    return np.array(message.position)
