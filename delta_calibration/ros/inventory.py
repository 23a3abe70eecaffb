"""Topics and services of each node, and an example of a command line that starts it.

Names are as declared: relative ones follow namespaces and remaps, `~/` stands for the node's name.
Interfaces that ROS gives every node (parameters, rosout, lifecycle) are left out. A test compares
the list with the real nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Types = Mapping[str, str]  # type by name

JOINT_STATE = "sensor_msgs/msg/JointState"
POSE, POINT = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PointStamped"
TEMPERATURE, INERTIA = "sensor_msgs/msg/Temperature", "geometry_msgs/msg/InertiaStamped"
STATUS, STATUSES = "diagnostic_msgs/msg/DiagnosticStatus", "diagnostic_msgs/msg/DiagnosticArray"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"

DIAGNOSTICS = {"/diagnostics": STATUSES}
PROGRESS = {"~/progress": STATUSES}
TRACKER = {"tracker/pose": POSE, "tracker/point": POINT}
CELL = {"cell/temperature": TEMPERATURE, "cell/payload": INERTIA}
INPUTS = {"joint_command": JOINT_STATE, "joint_states": JOINT_STATE, **TRACKER, **CELL}
DRIVEN = {"LISTENER/get_state": "lifecycle_msgs/srv/GetState"}


@dataclass(frozen=True)
class Inventory:
    """Topics and services of one node.

    Attributes:
        example: arguments behind `ros2 run delta_calibration NODE`.
        publishes: topics that it sends.
        subscribes: topics that it receives.
        serves: services that it offers.
        calls: services of other nodes; LISTENER stands for each subscriber of its commands.
        named: placeholders (capitals) in names, with the parameter that gives their value.
    """

    example: str
    publishes: Types
    subscribes: Types = field(default_factory=dict)
    serves: Types = field(default_factory=dict)
    calls: Types = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)


NODES = {
    "calibration_node": Inventory(
        "--ros-args -p robot:=srbd -p autostart:=true -p output:=calibration.yaml",
        publishes={
            "joint_command_compensated": JOINT_STATE,
            "joint_states_nominal": JOINT_STATE,
            "COMMAND_CONTROLLER/commands": "std_msgs/msg/Float64MultiArray",
            "TRAJECTORY_CONTROLLER/joint_trajectory": TRAJECTORY,
            "~/markers": "visualization_msgs/msg/MarkerArray",
            "~/status": STATUS,
            **PROGRESS,
            **DIAGNOSTICS,
        },
        subscribes={**INPUTS, "TRAJECTORY_INPUT": TRAJECTORY},
        serves={
            **dict.fromkeys(("~/start_capture", "~/stop_capture", "~/fit", "~/diagnose"), TRIGGER),
            **dict.fromkeys(("~/save", "~/reload"), TRIGGER),
            "~/enable": SET_BOOL,
        },
        named={
            name.upper(): name
            for name in ("command_controller", "trajectory_controller", "trajectory_input")
        },
    ),
    "simulated_tracker": Inventory(
        "--ros-args -p robot:=srbd -p seed:=4",
        publishes={"joint_states": JOINT_STATE, "tracker/pose": POSE, **CELL, **DIAGNOSTICS},
        subscribes={"joint_command_compensated": JOINT_STATE, "cell/payload": INERTIA},
    ),
    "measurement_plan": Inventory(
        "--ros-args -p robot:=srbd -p plan:=identify",
        publishes={"joint_command": JOINT_STATE, **PROGRESS, **DIAGNOSTICS},
        subscribes={"joint_states_nominal": JOINT_STATE, "joint_states": JOINT_STATE},
        calls=DRIVEN,
    ),
    "grid_positioner": Inventory(
        "--ros-args -p robot:=srbd -p points:=targets.csv",
        publishes={"joint_command": JOINT_STATE, **DIAGNOSTICS},
        subscribes={"joint_states": JOINT_STATE, **TRACKER},
        calls=DRIVEN,
    ),
    "robot_description": Inventory(
        "--ros-args -p robot:=srbd -p calibration:=calibration.yaml",
        publishes={
            "robot_description": "std_msgs/msg/String",
            "joint_states_all": JOINT_STATE,
            **DIAGNOSTICS,
        },
        subscribes={"joint_states": JOINT_STATE},
    ),
    "session_recorder": Inventory(
        "--ros-args -p output:=session_1", publishes=DIAGNOSTICS, subscribes=INPUTS
    ),
    "session_player": Inventory(
        "--ros-args -p session:=session_1 -p rate:=2.0",
        publishes={**INPUTS, "/clock": "rosgraph_msgs/msg/Clock"},
    ),
}
