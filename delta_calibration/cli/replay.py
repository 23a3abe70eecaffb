"""`delta-cal replay`: a session onto its topics."""

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


@click.command("replay", short_help="play a session onto its topics, with /clock")
@SESSION
@click.option(
    "--rate",
    type=Quantity(1e-3, 10_000),
    default=1.0,
    show_default=True,
    help="Times as fast as it was recorded.",
)
@click.option("--loop", is_flag=True, help="Begin again at the end.")
@click.option(
    "--start",
    type=Quantity(0, 1_000_000_000),
    default=0.0,
    show_default=True,
    help="Begin so many seconds in.",
)
def command(session: Path, rate: float, loop: bool, start: float) -> None:
    """Play SESSION by the node `session_player`; needs ROS. Ctrl-C ends it.

    It plays the commands, too: never where drives or a running cell listen. Set ROS_DOMAIN_ID to
    a number of its own first.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise InputError(
            "replay needs ROS 2 (rclpy), which this Python does not have; see the README"
        )
    inspect_session(session)  # refuse what cannot be read before a node is started
    parameters = {"session": str(session), "rate": rate, "loop": str(loop).lower(), "start": start}
    arguments = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    node = [sys.executable, "-m", "delta_calibration.ros.session_player", "--ros-args", *arguments]
    child = subprocess.Popen(node, env=child_environment())
    while True:
        try:
            code = child.wait()
            break
        except KeyboardInterrupt:  # the terminal has told the node as well; let it end in order
            continue
    if code != 0:
        raise SystemExit(code if code > 0 else 1)
