"""`delta-cal replay`: play a session on its topics."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import click

from delta_calibration.cli.options import SESSION
from delta_calibration.cli.quantity import Quantity
from delta_calibration.errors import InputError
from delta_calibration.processes import child_environment
from delta_calibration.recording import inspect_session


@click.command("replay")
@SESSION
@click.option(
    "--rate",
    type=Quantity(1e-3, 10_000),
    default=1.0,
    show_default=True,
    help="Speed of the replay relative to the recording.",
)
@click.option("--loop", is_flag=True, help="Start again when the end is reached.")
@click.option(
    "--start",
    type=Quantity(0, 1_000_000_000),
    default=0.0,
    show_default=True,
    help="Time in the session to start at [s].",
)
def command(session: Path, rate: float, loop: bool, start: float) -> None:
    """Play SESSION on its topics with the node `session_player`. Needs ROS 2; Ctrl-C ends it.

    The joint commands are played as well: never replay where drives or a running cell are
    listening. Set ROS_DOMAIN_ID to a number that nothing else uses first.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise InputError(
            "replay needs ROS 2 (rclpy), which this Python does not have; see the README"
        )
    inspect_session(session)  # refuse an unreadable session before a node is started
    parameters = {"session": str(session), "rate": rate, "loop": str(loop).lower(), "start": start}
    arguments = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    node = [sys.executable, "-m", "delta_calibration.ros.session_player", "--ros-args", *arguments]
    child = subprocess.Popen(node, env=child_environment())
    while True:
        try:
            code = child.wait()
            break
        except KeyboardInterrupt:  # the node has received Ctrl-C as well; wait until it ends
            continue
    if code != 0:
        raise SystemExit(code if code > 0 else 1)
