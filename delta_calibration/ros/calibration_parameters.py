"""Parameters of the calibration node."""

from __future__ import annotations

from dataclasses import replace

from delta_calibration.cell.calibration_session import Settings
from delta_calibration.cell.command_path import BEYOND_LIMITS, ON_FAILURE, PASS_THROUGH, REFUSE
from delta_calibration.cell.surroundings import TEMPERATURE_TIMEOUT_S
from delta_calibration.compensation import METHODS
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.ros.parameters import FRAME_PREFIX, ROBOT, ParameterTable, Spec

SPECS = (
    replace(ROBOT, description=f"{ROBOT.description}; from configure on", read_only=False),
    Spec(
        "calibration", "", "calibration file for configure and ~/reload; may be empty", path=True
    ),
    Spec("method", "newton", "how corrections are found; from configure on", choices=METHODS),
    Spec(
        "table",
        "",
        "file of a table of corrections for configure and ~/reload, with method table; empty: "
        "the table is made then",
        path=True,
    ),
    Spec(
        "on_failure",
        PASS_THROUGH,
        "what is sent for a command that cannot be compensated: itself, or the last good one",
        choices=ON_FAILURE,
    ),
    Spec(
        "beyond_limits",
        REFUSE,
        "what becomes of a command beyond a joint's limit, compensated or not: nothing is sent "
        "for it (the last good one with on_failure hold), or it is brought to the limit",
        choices=BEYOND_LIMITS,
    ),
    Spec("ramp_s", 1.0, "time [s] over which corrections come and go", range=(0.0, 60.0)),
    Spec(
        "max_correction_rate",
        0.0,
        "fastest change of a joint's correction in its own unit, [rad/s] or where joints slide "
        "[m/s]; 0: 5 rad/s of a Delta, of another robot what moves its platform as fast",
        range=(0.0, 1e5),
    ),
    Spec(
        "command_timeout_s",
        0.0,
        "age [s] by the node's clock beyond which a command is not sent any more, nor one stamped "
        "as far ahead; 0 for none, as where who commands has a clock of its own",
        range=(0.0, 3600.0),
    ),
    Spec(
        "temperature_timeout_s",
        TEMPERATURE_TIMEOUT_S,
        "age [s] beyond which a temperature is not known any more",
        range=(1.0, 86400.0),
    ),
    Spec(
        "payload_timeout_s",
        0.0,
        "the same of the payload; 0 for one that holds until it is said anew",
        range=(0.0, 86400.0),
    ),
    Spec(
        "model",
        "",
        "mechanism that ~/fit fits, empty for the robot file's; from configure on",
        choices=("", *MECHANISMS),
    ),
    Spec("tracker_timeout_s", 2.0, "silence [s] in a capture that is told", range=(0.1, 3600.0)),
    Spec(
        "capture_limit",
        1_000_000,
        "messages a capture holds at most; from configure on",
        range=(100, 100_000_000),
    ),
    Spec("seed", 0, "of the parts held out and of the swarm; from configure on", (0, 2**31 - 1)),
    Spec(
        "error_scale",
        100.0,
        "factor by which ~/markers draws errors longer than they are",
        range=(0.0, 1e5),
    ),
    Spec(
        "realtime_priority",
        0,
        "priority (SCHED_FIFO) of the node's threads while it is active, 0 for none; refused to "
        "users without rtprio, which diagnostics say; from activate on",
        range=(0, 99),
    ),
    Spec("output", "", "calibration file that ~/save writes", path=True),
    Spec(
        "enabled",
        False,
        "switch compensation on whenever the node is activated; wants a calibration",
        read_only=True,
    ),
    Spec(
        "command_controller",
        "",
        "forward_command_controller whose commands topic gets commands too; from configure on",
    ),
    Spec(
        "command_joints",
        ("",),
        "joints in that controller's order, with what the robot file passes through or without; "
        "empty for the file's, with it; from configure on",
    ),
    Spec(
        "trajectory_controller",
        "",
        "joint_trajectory_controller whose joint_trajectory topic gets commands too, each as a "
        "trajectory of one point, or what comes on trajectory_input; from configure on",
    ),
    Spec(
        "trajectory_input",
        "",
        "topic of trajectories to be compensated for trajectory_controller; from configure on",
    ),
    FRAME_PREFIX,
)


def desk_settings(table: ParameterTable) -> Settings:
    """What the parameters say now."""
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
    )
