"""A robot cell: the calibration node, what it works on, and who records and watches.

    ros2 launch delta_calibration cell.launch.py
    ros2 launch delta_calibration cell.launch.py plan:=identify record:=true session:=session_1
    ros2 launch delta_calibration cell.launch.py simulated:=false robot:=cell.yaml
    ros2 launch delta_calibration cell.launch.py play:=session_1

The first is a simulated cell in RViz, the second measures and records it, the third is a real one:
its motion controller publishes joint_command, its drives listen to joint_command_compensated, its
tracker driver publishes tracker/pose or tracker/point. The last shows what was recorded, and
starts nothing that drives listen to. `ros2 launch delta_calibration cell.launch.py --show-args`
lists the arguments.
"""

from __future__ import annotations

from typing import Any, List  # noqa: UP035

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import (
    Command,
    LaunchConfiguration,
    PathJoinSubstitution,
    PythonExpression,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

PACKAGE = "delta_calibration"
TEXTS = List[str]  # noqa: UP006  launch knows this one of the two, not list[str]
SWITCH = ("true", "false")
LOOK_S = 5.0  # [s] that a session waits for who watches
LIVE = ["'", LaunchConfiguration("play"), "' == ''"]  # there is a cell, real or simulated

ARGUMENTS: tuple[tuple[str, str, str, tuple[str, ...]], ...] = (
    ("robot", "srbd", "robot file, or the name of one that comes with the package", ()),
    ("calibration", "", "calibration file to start with; empty for none", ()),
    ("output", "calibration.yaml", "calibration file that ~/save writes", ()),
    ("simulated", "true", "a simulated machine and tracker in place of real ones", SWITCH),
    ("seed", "0", "of the simulated machine: another one for each", ()),
    ("effects", "['none']", "hidden in the simulated machine: \"['backlash:strength=1']\"", ()),
    ("record", "false", "record what is commanded and measured", SWITCH),
    ("session", "session", "folder to record to; must not exist", ()),
    ("plan", "", "plan or CSV file of points to drive through, once; empty for none", ()),
    ("play", "", "session to be shown in place of a cell; empty for none", ()),
    ("rviz", "true", "RViz with config/cell.rviz", SWITCH),
    ("foxglove", "false", "foxglove_bridge (port 8765), for config/cell.foxglove.json", SWITCH),
)


def generate_launch_description() -> LaunchDescription:
    """Arguments, then nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text, **_of(choices))
        for name, default, text, choices in ARGUMENTS
    ]
    return LaunchDescription([*declared, *_cell(), *_measurement(), *_view()])


def _cell() -> list[Node]:
    """What the commands go through, and without a real machine what answers them."""
    return [
        _own(
            "calibration_node",
            _if(LIVE),
            autostart=True,
            robot=_text("robot"),
            calibration=_text("calibration"),
            output=_text("output"),
        ),
        _own(
            "simulated_tracker",
            _if(LIVE, " and ", _says_true("simulated")),
            robot=_text("robot"),
            seed=_value("seed", int),
            effects=_value("effects", TEXTS),
        ),
    ]


def _measurement() -> list[Node]:
    """What drives, and what writes down; who drives waits for who writes. Or what is played."""
    recorded = _says_true("record")
    listeners = PythonExpression(["2 if ", *recorded, " else 1"])
    return [
        _own("session_recorder", _if(LIVE, " and ", recorded), output=_text("session")),
        _own(
            "measurement_plan",
            _if(LIVE, " and '", LaunchConfiguration("plan"), "' != ''"),
            robot=_text("robot"),
            plan=_text("plan"),
            subscribers=ParameterValue(listeners, value_type=int),
        ),
        _own(
            "session_player",
            _if("not (", LIVE, ")"),
            session=_text("play"),
            wait_for_subscribers=LOOK_S,
        ),
    ]


def _view() -> list[Node]:
    """Where the links are: joint states with the passive joints, frames of them, and viewers."""
    played = PythonExpression(["not (", *LIVE, ")"])
    clock = {"use_sim_time": ParameterValue(played, value_type=bool)}
    config = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "cell.rviz"])
    return [
        _own("robot_description", robot=_text("robot"), calibration=_text("calibration")),
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{"robot_description": ParameterValue(_urdf(), value_type=str), **clock}],
            # robot_description is published by the node of that name already
            remappings=[
                ("joint_states", "joint_states_all"),
                ("robot_description", "~/robot_description"),
            ],
        ),
        Node(
            package="rviz2",
            executable="rviz2",
            arguments=["-d", config],
            parameters=[clock],
            condition=_if(_says_true("rviz")),
        ),
        Node(
            package="foxglove_bridge",
            executable="foxglove_bridge",
            parameters=[clock],
            condition=_if(_says_true("foxglove")),
        ),
    ]


def _urdf() -> Command:
    """What `delta-cal urdf` prints."""
    calibration = LaunchConfiguration("calibration")
    option = ["'--calibration \"", calibration, "\"' if '", calibration, "' else ''"]
    program = ExecutableInPackage(executable="delta-cal", package=PACKAGE)
    robot = [' urdf --robot "', LaunchConfiguration("robot"), '" ']
    return Command([program, *robot, PythonExpression(option)], on_stderr="warn")


def _own(executable: str, condition: IfCondition | None = None, **parameters: Any) -> Node:
    """A node of this package; it has the name of its executable."""
    return Node(
        package=PACKAGE,
        executable=executable,
        parameters=[parameters],
        output="screen",
        condition=condition,
    )


def _if(*parts: Any) -> IfCondition:
    """A condition in Python, of texts, substitutions and lists of them."""
    flat = [word for part in parts for word in (part if isinstance(part, list) else [part])]
    return IfCondition(PythonExpression(flat))


def _says_true(argument: str) -> list[Any]:
    return ["'", LaunchConfiguration(argument), "' == 'true'"]


def _text(argument: str) -> ParameterValue:
    return _value(argument, str)  # a robot called 12 stays a text


def _value(argument: str, kind: Any) -> ParameterValue:
    return ParameterValue(LaunchConfiguration(argument), value_type=kind)


def _of(choices: tuple[str, ...]) -> dict[str, Any]:
    return {"choices": list(choices)} if choices else {}
