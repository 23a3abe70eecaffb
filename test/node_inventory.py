"""Topics and services of the package's nodes, queried from real nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from delta_calibration.ros.calibration_node import CalibrationNode
from delta_calibration.ros.grid_positioner import GridPositioner
from delta_calibration.ros.measurement_plan import MeasurementPlan
from delta_calibration.ros.robot_description import RobotDescription
from delta_calibration.ros.session_player import SessionPlayer
from delta_calibration.ros.session_recorder import SessionRecorder
from delta_calibration.ros.simulated_tracker import SimulatedTracker
from ros_helpers import Bench

BAGS = Path(__file__).parents[1] / "bags"
# Topics and services that ROS itself gives every node, or every lifecycle node.
ROS_OWN = {
    "parameter_events",
    "rosout",
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
    "change_state",
    "get_state",
    "get_available_states",
    "get_available_transitions",
    "get_transition_graph",
    "transition_event",
}


@dataclass(frozen=True, order=True)
class End:
    """One end of a topic or service at a node."""

    page: str  # page of msg_docs: the name, with underscores for slashes
    node: str
    direction: str  # publishes, subscribes, serves
    type_name: str
    qos: str  # of a topic


def every_node(bench: Bench, folder: Path) -> dict[str, Node]:
    """Each node of the package, with all options switched on."""
    points = folder / "points.csv"
    points.write_text("x_mm,y_mm,z_mm\n0,0,-750\n")
    kinds = {
        CalibrationNode: {
            "command_controller": "controller",
            "trajectory_controller": "controller",
            "trajectory_input": "trajectory_input",
        },
        SimulatedTracker: {},
        MeasurementPlan: {},
        RobotDescription: {},
        GridPositioner: {"points": str(points)},
        SessionRecorder: {"output": str(folder / "recorded")},
        SessionPlayer: {"session": str(BAGS / "srbd_plain")},
    }
    made = {}
    for kind, values in kinds.items():
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        node = bench.add(kind(context=bench.context, parameter_overrides=overrides))
        made[node.get_name()] = node
    made["calibration_node"].trigger_configure()
    return made


def ends(node: Node) -> Iterator[End]:
    """Topics and services of a node, without those of ROS itself."""
    name = node.get_name()
    for direction, entities in (
        ("publishes", node.publishers),
        ("subscribes", node.subscriptions),
    ):
        for entity in entities:
            kind, qos = type_name(entity.msg_type), qos_words(entity.qos_profile)
            yield End(page_of(entity.topic_name), name, direction, kind, qos)
    for service in node.services:
        kind = type_name(service.srv_type)
        yield End(page_of(service.service_name), name, "serves", kind, "")


def inventory(bench: Bench, folder: Path) -> set[End]:
    """Everything that must have a page."""
    nodes = every_node(bench, folder)
    every = {end for node in nodes.values() for end in ends(node)}
    nodes["session_recorder"].close()
    return {end for end in every if end.page.removeprefix(f"{end.node}_") not in ROS_OWN}


def page_of(name: str) -> str:
    """Name of the page: `/tracker/point` -> `tracker_point`."""
    return name.strip("/").replace("/", "_")


def type_name(kind: type) -> str:
    """Name of a type, such as `sensor_msgs/msg/JointState`."""
    package, group, *_ = kind.__module__.split(".")
    return f"{package}/{group}/{kind.__name__}"


def qos_words(qos: QoSProfile) -> str:
    """Quality of service in words, such as `reliable, volatile, depth 100`."""
    reliable = qos.reliability == ReliabilityPolicy.RELIABLE
    latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return ", ".join(
        [
            "reliable" if reliable else "best effort",
            "transient local" if latched else "volatile",
            f"depth {qos.depth}",
        ]
    )
