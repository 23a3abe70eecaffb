"""Parameters of the calibration node."""

from __future__ import annotations

from dataclasses import replace

from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_topic_name import validate_topic_name

from delta_calibration.cell.calibration_session import Settings
from delta_calibration.cell.command_path import BEYOND_LIMITS, ON_FAILURE, PASS_THROUGH, REFUSE
from delta_calibration.cell.surroundings import TEMPERATURE_TIMEOUT_S
from delta_calibration.compensation import METHODS
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.ros.parameters import FRAME_PREFIX, ROBOT, ParameterTable, Spec

SPECS = (
    replace(ROBOT, description=f"{ROBOT.description}; takes effect at configure", read_only=False),
    Spec(
        "calibration", "", "calibration file for configure and ~/reload; may be empty", path=True
    ),
    Spec(
        "method",
        "newton",
        "how corrections are computed; takes effect at configure",
        choices=METHODS,
    ),
    Spec(
        "table",
        "",
        "file with a table of corrections for method table, read at configure and ~/reload; "
        "empty: the table is computed then",
        path=True,
    ),
    Spec(
        "on_failure",
        PASS_THROUGH,
        "what is sent for a command that cannot be compensated: the command itself, or the last "
        "good one",
        choices=ON_FAILURE,
    ),
    Spec(
        "beyond_limits",
        REFUSE,
        "what happens to a command beyond a joint limit, compensated or not: refuse sends "
        "nothing (with on_failure hold, the last good command), clamp sends the limit",
        choices=BEYOND_LIMITS,
    ),
    Spec("ramp_s", 1.0, "time [s] over which corrections fade in and out", range=(0.0, 60.0)),
    Spec(
        "max_correction_rate",
        0.0,
        "largest rate of change of a joint's correction [rad/s; m/s for sliding joints]; 0: 5 "
        "rad/s on a Delta, the equivalent on other robots",
        range=(0.0, 1e5),
    ),
    Spec(
        "command_timeout_s",
        0.0,
        "largest age [s] of a command that is sent, by the node's clock; commands stamped as "
        "far ahead are not sent either; 0: no limit, for a sender with its own clock",
        range=(0.0, 3600.0),
    ),
    Spec(
        "temperature_timeout_s",
        TEMPERATURE_TIMEOUT_S,
        "age [s] after which a temperature counts as unknown",
        range=(1.0, 86400.0),
    ),
    Spec(
        "payload_timeout_s",
        0.0,
        "age [s] after which the payload counts as unknown; 0: it is valid until the next message",
        range=(0.0, 86400.0),
    ),
    Spec(
        "model",
        "",
        "mechanism that ~/fit fits, empty for the robot file's; takes effect at configure",
        choices=("", *MECHANISMS),
    ),
    Spec(
        "tracker_timeout_s",
        2.0,
        "silence [s] of a stream during a capture after which a warning is given",
        range=(0.1, 3600.0),
    ),
    Spec(
        "capture_limit",
        1_000_000,
        "largest number of messages in a capture; takes effect at configure",
        range=(100, 100_000_000),
    ),
    Spec(
        "watch_false_alarms",
        0.0,
        "largest number of false alarms per month of the watch, which reports on /diagnostics "
        "that readings at rest no longer fit the calibration; 0: no watch; takes effect at "
        "configure",
        range=(0.0, 10.0),
    ),
    Spec(
        "history",
        "",
        "history to which every fit is added (docs/history.md): an SQLite file or the URL of a "
        "database; empty for none",
        read_only=True,
        path=True,
    ),
    Spec("machine", "", "name of the machine in the history", read_only=True),
    Spec(
        "history_bags",
        "history_bags",
        "folder to which captured sessions are written for the history",
        read_only=True,
        path=True,
    ),
    Spec(
        "history_update",
        False,
        "whether every ~/fit uses the results of the earlier sessions in the history; a fit with "
        "fewer than 12 places always does",
        read_only=True,
    ),
    Spec(
        "seed",
        0,
        "seed of the random numbers of a fit (held-out parts, swarm); takes effect at configure",
        (0, 2**31 - 1),
    ),
    Spec(
        "error_scale",
        100.0,
        "magnification of the errors in ~/markers",
        range=(0.0, 1e5),
    ),
    Spec(
        "realtime_priority",
        0,
        "real-time priority (SCHED_FIFO) of the node's threads while it is active; 0: none. It "
        "needs the right rtprio; without it, diagnostics report the refusal. Takes effect at "
        "activate",
        range=(0, 99),
    ),
    Spec("output", "", "calibration file that ~/save writes", path=True),
    Spec(
        "enabled",
        False,
        "switch compensation on whenever the node is activated; needs a calibration",
        read_only=True,
    ),
    Spec(
        "command_controller",
        "",
        "name of a forward_command_controller that also receives the commands (topic commands); "
        "takes effect at configure",
    ),
    Spec(
        "command_joints",
        ("",),
        "joints in the order of command_controller, with or without the passed-through axes of "
        "the robot file; empty: the order of the robot file, with these axes; takes effect at "
        "configure",
    ),
    Spec(
        "trajectory_controller",
        "",
        "name of a joint_trajectory_controller that also receives the commands (topic "
        "joint_trajectory), each as a trajectory of one point, or the trajectories of "
        "trajectory_input; takes effect at configure",
    ),
    Spec(
        "trajectory_input",
        "",
        "topic of trajectories that are compensated and sent to trajectory_controller; takes "
        "effect at configure",
    ),
    FRAME_PREFIX,
)


def desk_settings(table: ParameterTable) -> Settings:
    """Settings of the session from the present values of the parameters."""
    return Settings(
        robot=table.named("robot"),
        calibration=str(table.path("calibration") or ""),
        method=table.text("method"),
        table=str(table.path("table") or ""),
        on_failure=table.text("on_failure"),
        beyond_limits=table.text("beyond_limits"),
        ramp_s=table.number("ramp_s"),
        rate=table.number("max_correction_rate"),
        command_timeout_s=table.number("command_timeout_s"),
        temperature_timeout_s=table.number("temperature_timeout_s"),
        payload_timeout_s=table.number("payload_timeout_s"),
        model=table.text("model"),
        capture_limit=table.integer("capture_limit"),
        seed=table.integer("seed"),
        false_alarms=table.number("watch_false_alarms"),
        history=_store(table),
        machine=table.text("machine"),
        bags=str(table.path("history_bags") or ""),
        update=table.flag("history_update"),
    )


def topic_named(table: ParameterTable, name: str) -> str:
    """Topic name, or beginning of one, from a parameter; empty for none.

    Raises:
        InputError: it is not a valid topic name.
    """
    text = table.text(name)
    try:
        if text:
            validate_topic_name(text)
    except InvalidTopicNameException as error:
        why = " ".join(str(error).split("\n")[0].split())
        raise InputError(f"parameter {name}: {text!r}: {why}") from error
    return text


def _store(table: ParameterTable) -> str:
    """The history's database: a URL as it is, or a file."""
    text = table.text("history")
    return text if "://" in text else str(table.path("history") or "")
