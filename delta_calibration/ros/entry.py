"""Entry points of the node executables; without rclpy they print a message and exit with 2."""

from __future__ import annotations

import signal
import sys
from typing import NoReturn

from delta_calibration.errors import InputError
from delta_calibration.loading import load
from delta_calibration.ros.inventory import NODES
from delta_calibration.ros.watchdog import leave

MISSING = (
    "{executable}: rclpy is not installed for {python}: source a ROS 2 Jazzy setup, "
    "or install delta_calibration[ros]\n"
)


def run_node(executable: str) -> int:
    """Run `main()` of the module named like the executable, or print its help (`--help`).

    Args:
        executable: name of a node module in this package, such as `session_recorder`.

    Returns:
        The process's exit code.
    """
    handler = signal.signal(signal.SIGINT, signal.SIG_DFL)  # no traceback out of an import
    try:
        load("rclpy")
    except ImportError:
        signal.signal(signal.SIGINT, handler)
        sys.stderr.write(MISSING.format(executable=executable, python=sys.executable))
        return InputError.exit_code
    module = load(f"delta_calibration.ros.{executable}")
    node_help = load("delta_calibration.ros.node_help")
    if node_help.asks_for_help(sys.argv):
        sys.stdout.write(node_help.help_text(executable))
        return 0
    return int(module.main())


def session_recorder() -> NoReturn:
    """Record a session from the cell's topics."""
    leave(run_node("session_recorder"))


def session_player() -> NoReturn:
    """Play a session onto its topics."""
    leave(run_node("session_player"))


def calibration_node() -> NoReturn:
    """Compensate joint commands, capture measurements, fit."""
    leave(run_node("calibration_node"))


def simulated_tracker() -> NoReturn:
    """Stand in for a machine and the tracker that measures it."""
    leave(run_node("simulated_tracker"))


def measurement_plan() -> NoReturn:
    """Drive a machine through a plan of poses."""
    leave(run_node("measurement_plan"))


def grid_positioner() -> NoReturn:
    """Correct points with the tracker alone, without a model."""
    leave(run_node("grid_positioner"))


def robot_description() -> NoReturn:
    """Show the robot: URDF, and the states of all its joints."""
    leave(run_node("robot_description"))


def _named() -> int:
    """Run the node whose name is the first argument: `python -m delta_calibration.ros.entry`."""
    name = sys.argv.pop(1) if len(sys.argv) > 1 else ""
    if name not in NODES:
        sys.stderr.write(f"{name!r} is not a node; choose from: {', '.join(NODES)}\n")
        return InputError.exit_code
    return run_node(name)


if __name__ == "__main__":
    leave(_named())
