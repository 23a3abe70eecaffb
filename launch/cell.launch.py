"""A robot cell: the calibration node, what it works on, and who records and watches.

    ros2 launch delta_calibration cell.launch.py
    ros2 launch delta_calibration cell.launch.py plan:=identify record:=true session:=session_1
    ros2 launch delta_calibration cell.launch.py simulated:=false robot:=cell.yaml
    ros2 launch delta_calibration cell.launch.py namespace:=left robot:=left.yaml
    ros2 launch delta_calibration cell.launch.py play:=session_1

The first is a simulated cell in RViz, the second measures and records it, the third is a real one:
its motion controller publishes joint_command, its drives listen to joint_command_compensated, its
tracker driver publishes tracker/pose or tracker/point. The fourth is one robot of several, with
topics and frames of its own. The last shows what was recorded, and starts nothing that drives
listen to. `ros2 launch delta_calibration cell.launch.py --show-args` lists the arguments.

Everything is looked for before anything is started. Where a node ends that the commands or a
recording depend on, all others are ended too; a viewer that is closed ends nothing.
"""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path
from typing import Any, List, NamedTuple  # noqa: UP035

from ament_index_python.packages import PackageNotFoundError
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import (
    Command,
    LaunchConfiguration,
    PathJoinSubstitution,
    SubstitutionFailure,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

PACKAGE = "delta_calibration"
DISTRIBUTION = "jazzy"
TEXTS = List[str]  # noqa: UP006  launch knows this one of the two, not list[str]
SWITCH = ("true", "false")
AUTO = "auto"
LOOK_S = 5.0  # [s] that a session waits for who watches
CLOSE_S = "25"  # [s] for a recording to be closed on a slow disk; launch's own is 5
NAMESPACE = re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
NUMBER = re.compile(r"\d+(\.\d*)?", re.ASCII)
VIEWED = ("robot_description", "calibration_node/markers", "tracker/pose", "tracker/point")
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")

ARGUMENTS: tuple[tuple[str, str, str, tuple[str, ...]], ...] = (
    ("robot", "srbd", "robot file, or the name of one that comes with the package", ()),
    ("calibration", "", "calibration file to start with; empty for none", ()),
    ("output", "", "calibration file that ~/save writes; empty: [NAMESPACE_]calibration.yaml", ()),
    ("namespace", "", "namespace of nodes and topics, one for each robot; empty for none", ()),
    ("frame_prefix", AUTO, "prefix of the frame names; auto: the namespace and a slash", ()),
    ("params_file", "", "YAML file with parameters; the arguments here take precedence", ()),
    ("method", "", "how corrections are computed; empty: newton", ("", "apso", "newton", "table")),
    (
        "on_failure",
        "",
        "what is sent for a command that cannot be compensated; empty: pass_through",
        ("", "pass_through", "hold"),
    ),
    ("command_timeout_s", "", "largest age [s] of a command that is sent; empty: no limit", ()),
    ("simulated", "true", "simulate the machine and the tracker", SWITCH),
    ("seed", "0", "seed of the simulated machine", ()),
    (
        "effects",
        "['none']",
        "causes of error in the simulated machine: \"['backlash:strength=1']\"",
        (),
    ),
    ("record", "false", "record commands and measurements", SWITCH),
    ("session", "", "folder to record to, which must not exist; empty: [NAMESPACE_]session", ()),
    ("plan", "", "plan or CSV file of points that is run once; empty for none", ()),
    ("play", "", "session to replay instead of running a cell; empty for none", ()),
    (
        "rviz",
        AUTO,
        "RViz with config/cell.rviz; auto: if installed and a display exists",
        (AUTO, *SWITCH),
    ),
    (
        "foxglove",
        "false",
        "start foxglove_bridge (port 8765) for config/cell.foxglove.json",
        SWITCH,
    ),
)


class Cell(NamedTuple):  # no dataclass: launch does not register this module, which one needs
    """What the arguments ask for."""

    given: dict[str, str]
    namespace: str  # without slashes around it; empty for none
    prefix: str  # of frames

    def says(self, argument: str) -> bool:
        """Whether a switch is on."""
        return self.given[argument] == "true"

    def named(self, argument: str, usual: str) -> str:
        """A file of this robot alone, unless it was named."""
        return self.given[argument] or "_".join(filter(None, [*self.spaces, usual]))

    @property
    def spaces(self) -> list[str]:
        """Parts of the namespace."""
        return self.namespace.split("/") if self.namespace else []


class Program(NamedTuple):
    """A node to be started; where a required one ends, all end."""

    executable: str
    parameters: dict[str, Any]
    package: str = PACKAGE
    required: bool = False
    options: dict[str, Any] = {}  # of launch_ros's Node  # noqa: RUF012


def generate_launch_description() -> LaunchDescription:
    """Arguments, then what they ask for."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text, **_of(choices))
        for name, default, text, choices in ARGUMENTS
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list[Node]:
    """All nodes; whatever is wrong or missing is told here, before the first one is started."""
    cell = _asked({name: LaunchConfiguration(name).perform(context) for name, *_ in ARGUMENTS})
    begun = _played(cell) if cell.given["play"] else _live(cell)
    programs = [*begun, *_view(cell, context)]
    for program in programs:
        why = _missing(program, context)
        if why:
            raise _refusal(why)
    return [_node(cell, program) for program in programs]


def _asked(given: dict[str, str]) -> Cell:
    """The arguments, once they are sound.

    Raises:
        RuntimeError: one is not.
    """
    namespace, prefix = given["namespace"].strip("/"), given["frame_prefix"]
    if namespace and not NAMESPACE.fullmatch(namespace):
        raise _refusal(f"namespace: {namespace!r} is not a valid name; use letters, digits and _")
    if prefix == AUTO:
        prefix = f"{namespace}/" if namespace else ""
    file, age = given["params_file"], given["command_timeout_s"]
    if file and not Path(file).is_file():
        raise _refusal(f"params_file: {file} is not a file")
    if age and not NUMBER.fullmatch(age):
        raise _refusal(f"command_timeout_s: {age!r} is not a time in seconds")
    return Cell(given, namespace, prefix)


def _live(cell: Cell) -> list[Program]:
    """What the commands go through, what answers them, who drives and who writes down."""
    given, robot = cell.given, _text(cell.given["robot"])
    programs = [
        Program(
            "calibration_node",
            {
                "autostart": True,
                "robot": robot,
                "calibration": _text(given["calibration"]),
                "output": _text(cell.named("output", "calibration.yaml")),
                "frame_prefix": _text(cell.prefix),
                **_choices(given),
            },
            required=True,
        )
    ]
    if cell.says("simulated"):
        machine = {
            "robot": robot,
            "seed": ParameterValue(given["seed"], value_type=int),
            "effects": ParameterValue(given["effects"], value_type=TEXTS),
            "frame_prefix": _text(cell.prefix),
        }
        programs.append(Program("simulated_tracker", machine, required=True))
    if cell.says("record"):
        session = {"output": _text(cell.named("session", "session"))}
        patience = {"sigterm_timeout": CLOSE_S}
        programs.append(Program("session_recorder", session, required=True, options=patience))
    if given["plan"]:
        listeners = 2 if cell.says("record") else 1  # who drives waits for who writes
        plan = {"robot": robot, "plan": _text(given["plan"]), "subscribers": listeners}
        programs.append(Program("measurement_plan", plan))
    return programs


def _choices(given: dict[str, str]) -> dict[str, Any]:
    """What was chosen for the calibration node; the rest is its own default, or params_file's."""
    chosen: dict[str, Any] = {
        name: _text(given[name]) for name in ("method", "on_failure") if given[name]
    }
    if given["command_timeout_s"]:
        chosen["command_timeout_s"] = float(given["command_timeout_s"])
    return chosen


def _played(cell: Cell) -> list[Program]:
    """What says again what was recorded."""
    session = {"session": _text(cell.given["play"]), "wait_for_subscribers": LOOK_S}
    return [Program("session_player", session)]


def _view(cell: Cell, context: LaunchContext) -> list[Program]:
    """Where the links are: joint states with the passive joints, frames of them, and viewers."""
    robot = {
        "robot": _text(cell.given["robot"]),
        "calibration": _text(cell.given["calibration"]),
        "frame_prefix": _text(cell.prefix),
    }
    clock = {"use_sim_time": bool(cell.given["play"])}
    # Links have their prefix in the URDF: the publisher adds none of its own.
    links = {"robot_description": _text(_urdf(cell).perform(context)), **clock}
    # robot_description is published by the node of that name already
    names = [("joint_states", "joint_states_all"), ("robot_description", "~/robot_description")]
    programs = [
        Program("robot_description", robot),
        _foreign("robot_state_publisher", links, remappings=names),
    ]
    rviz = _foreign("rviz2", clock, **_look_of_rviz(cell))
    if cell.says("rviz") or (cell.given["rviz"] == AUTO and _screen(rviz, context)):
        programs.append(rviz)
    if cell.says("foxglove"):
        programs.append(_foreign("foxglove_bridge", clock))
    return programs


def _urdf(cell: Cell) -> Command:
    """What `delta-cal urdf` prints."""
    program = ExecutableInPackage(executable="delta-cal", package=PACKAGE)
    options = {
        "robot": cell.given["robot"],
        "calibration": cell.given["calibration"],
        "frame-prefix": cell.prefix,
    }
    words = [f" --{name} {shlex.quote(value)}" for name, value in options.items() if value]
    return Command([program, " urdf", *words], on_stderr="warn")


def _look_of_rviz(cell: Cell) -> dict[str, Any]:
    """What is set up for a robot alone, on the topics and frames of this one."""
    config = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "cell.rviz"])
    arguments = ["-d", config, "-f", f"{cell.prefix}base_link"]
    names = [(f"/{topic}", f"/{cell.namespace}/{topic}") for topic in VIEWED]
    return {"arguments": arguments, "remappings": names if cell.namespace else []}


def _screen(rviz: Program, context: LaunchContext) -> bool:
    """Whether RViz is installed, and has something to show itself on."""
    return any(map(os.environ.get, DISPLAYS)) and not _missing(rviz, context)


def _missing(program: Program, context: LaunchContext) -> str:
    """What is wrong with a program's installation; nothing where it can be started."""
    try:
        ExecutableInPackage(program.executable, program.package).perform(context)
    except PackageNotFoundError:
        name = f"ros-{DISTRIBUTION}-{program.package.replace('_', '-')}"
        return f"package {program.package} is not installed: sudo apt install {name}"
    except SubstitutionFailure as error:
        return str(error)
    return ""


def _node(cell: Cell, program: Program) -> Node:
    own = program.package == PACKAGE
    file = [cell.given["params_file"]] if own and cell.given["params_file"] else []
    end = Shutdown(reason=f"{program.executable} has ended") if program.required else None
    return Node(
        package=program.package,
        executable=program.executable,
        namespace=cell.namespace or None,
        parameters=[*file, program.parameters],  # what is named later goes before
        output="screen" if own else "log",
        on_exit=end,
        **program.options,
    )


def _foreign(name: str, parameters: dict[str, Any], **options: Any) -> Program:
    """A program of another package that has its name."""
    return Program(name, parameters, name, options=options)


def _refusal(why: str) -> RuntimeError:
    return RuntimeError(f"nothing was started: {why}")


def _text(value: str) -> ParameterValue:
    return ParameterValue(value, value_type=str)  # a robot called 12 stays a text


def _of(choices: tuple[str, ...]) -> dict[str, Any]:
    return {"choices": list(choices)} if choices else {}
